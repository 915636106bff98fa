"""ancf2d: planar flexible multibody dynamics with ANCF beam elements.

For Python: ``load``, ``solve``, ``convergence``, ``sensitivity``, ``optimise``, ``fit``, ``system``,
``open_results``, and the errors that they raise; docs/python.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import Convergence as Convergence
    from .api import Solution as Solution
    from .api import convergence as convergence
    from .api import fit as fit
    from .api import load as load
    from .api import optimise as optimise
    from .api import sensitivity as sensitivity
    from .api import solve as solve
    from .api import system as system
    from .case import LoadedCase as LoadedCase
    from .errors import Ancf2dError as Ancf2dError
    from .errors import CaseError as CaseError
    from .errors import ComputationError as ComputationError
    from .errors import ResultsError as ResultsError
    from .results import Results as Results
    from .results import open_results as open_results
    from .solvers.discrete_model import DiscreteModel as DiscreteModel

__version__ = "0.1.0"

# the public names and their modules; a module is imported when one of its names is first used
_PLACES = {
    "load": "api", "solve": "api", "convergence": "api", "sensitivity": "api", "optimise": "api", "fit": "api",
    "system": "api", "Solution": "api",
    "LoadedCase": "case", "DiscreteModel": "solvers.discrete_model",
    "open_results": "results", "Results": "results", "Convergence": "api",
    "Ancf2dError": "errors", "CaseError": "errors", "ComputationError": "errors", "ResultsError": "errors",
}
__all__ = ["__version__", *_PLACES]


def __getattr__(name: str) -> Any:
    """Return one of the public names, importing its module now. Raises AttributeError for any other name."""
    if name not in _PLACES:
        raise AttributeError(f"module 'ancf2d' has no attribute '{name}'")
    globals()[name] = found = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    return found


def __dir__() -> list[str]:
    """Return the names already in the module and those imported on use."""
    return sorted({*globals(), *_PLACES})
