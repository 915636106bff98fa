"""Why a case was not solved, as a row of a study tells it."""

from __future__ import annotations

from ..errors import CaseError, ComputationError

# what costs a study one row
UNSOLVED = (CaseError, ComputationError, MemoryError)


def verdict(error: BaseException) -> tuple[str, str]:
    """Return the status (refused as a case, or failed by the computation) and the reason of an UNSOLVED error."""
    if isinstance(error, CaseError):
        return "refused", error.problems[0].sentence
    if isinstance(error, ComputationError):
        return "failed", error.failure.reason
    return "failed", "there is not enough memory for this case"
