"""ancf2d for Python: ``ancf2d.load``, ``ancf2d.solve``, ``ancf2d.convergence`` and ``ancf2d.system``."""

from .solution import Convergence, Solution
from .solving import convergence, load, solve, system

__all__ = ["Convergence", "Solution", "convergence", "load", "solve", "system"]
