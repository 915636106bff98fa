"""Python interface of ancf2d: ``ancf2d.load``, ``ancf2d.solve``, ``ancf2d.convergence``, ``ancf2d.sensitivity``,
``ancf2d.optimise``, ``ancf2d.fit`` and ``ancf2d.system``."""

from .solution import Convergence, Solution
from .solving import convergence, fit, load, optimise, sensitivity, solve, system

__all__ = ["Convergence", "Solution", "convergence", "fit", "load", "optimise", "sensitivity", "solve", "system"]
