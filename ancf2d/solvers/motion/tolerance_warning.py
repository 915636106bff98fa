"""The warning about a motion with adaptive steps whose estimated error is far above its tolerance."""

from __future__ import annotations

from ...kernels.motion.state import COUNT
from ...model.timing import rates_of
from .integrators import INTEGRATORS, default_method
from .stepping import Stepper

# multiple of the tolerance above which errors cause a warning
MISSED = 10.0
# if ten times the tolerance changes the error by less than this factor, the error does not depend on it
ASYMPTOTIC = 2.0**0.5
# smallest share of the tolerance that is recommended: errors were observed with up to a hundred times the tolerance
SMALLEST = 0.01


def missed_tolerance(stepper: Stepper, estimate: float, order: float) -> list[str]:
    """Return a warning that the error is far above the tolerance, and whether steps or motion cause it.

    ``order``: the observed power of the tolerance with which errors grow.
    """
    case, tolerance, count = stepper.model.case, stepper.tolerance, int(stepper.s.numbers[COUNT])
    # no warning for the default tolerance, nor where the accuracy control judges the runs itself
    asked = getattr(case.solver, "tolerance", None) is not None and case.accuracy is None
    if estimate <= MISSED * tolerance or not asked:
        return []
    said = (f"the tolerance is missed: the estimated error is {estimate:.2g} of the largest displacements, "
            f"{estimate / tolerance:.0f} times the tolerance {tolerance:g}. ")
    if estimate > count * tolerance:
        # errors that do not grow add up to at most the number of steps times the tolerance
        return [said + "The errors grow, because the motion is sensitive to its initial state, like chaotic motions. A "
                "smaller tolerance only postpones the time from which the motion is unreliable; its statistics may "
                "still be right"]
    if 10.0 ** order < ASYMPTOTIC:
        return [said + "Ten times the tolerance gives about the same error: the steps skip fast vibrations, which "
                "only a much smaller tolerance resolves. If these vibrations do not matter, use a larger tolerance"
                + _better(stepper) + _jump(stepper)]
    share = (MISSED * tolerance / estimate) ** (1.0 / min(order, 1.0))
    return [said + "Each step meets the tolerance, but the errors add up. Use a tolerance of about "
            f"{max(min(share, 0.5), SMALLEST) * tolerance:.1g}" + _better(stepper) + _jump(stepper)]


def _better(stepper: Stepper) -> str:
    """Return advice to use the recommended method if its order is higher: it errs less with fewer steps."""
    best = INTEGRATORS[default_method(stepper.model)]
    better = best.order > stepper.method.order
    return f". Method {best.name} has a smaller error with fewer steps" if better else ""


def _jump(stepper: Stepper) -> str:
    """Return a hint if a prescribed motion starts a model at rest with a jump of velocity, like an impact."""
    model = stepper.model
    # moving obstacles move nothing before they touch
    obstacles = [s for pair in model.contacts for s in pair.signal or ()]
    signals = [stepper.signals[k] for k in stepper.driving]
    if model.case.initial is not None or not any(rates_of(s, 0.0)[0] for s in signals if s not in obstacles):
        return ""
    return (". A prescribed motion begins at full speed, which excites vibrations like an impact. Let it begin "
            "gradually, or give initial velocities")
