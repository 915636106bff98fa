"""Derivatives of the results of solvers by the numbers of a case."""
