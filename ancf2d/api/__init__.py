"""ancf2d for Python: ``ancf2d.load``, ``ancf2d.solve``, ``ancf2d.convergence``, ``ancf2d.sensitivity``,
``ancf2d.optimise`` and ``ancf2d.system``."""

from .solution import Convergence, Solution
from .solving import convergence, load, optimise, sensitivity, solve, system

__all__ = ["Convergence", "Solution", "convergence", "load", "optimise", "sensitivity", "solve", "system"]
