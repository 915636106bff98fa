"""ancf2d for Python: cases in, solutions out, as ``ancf2d.load``, ``ancf2d.solve`` and ``ancf2d.convergence``."""

from .solution import Solution
from .solving import convergence, load, solve

__all__ = ["Solution", "convergence", "load", "solve"]
