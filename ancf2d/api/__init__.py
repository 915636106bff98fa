"""ancf2d for Python: ``ancf2d.load``, ``ancf2d.solve``, ``ancf2d.convergence``, ``ancf2d.sensitivity`` and
``ancf2d.system``."""

from .solution import Convergence, Solution
from .solving import convergence, load, sensitivity, solve, system

__all__ = ["Convergence", "Solution", "convergence", "load", "sensitivity", "solve", "system"]
