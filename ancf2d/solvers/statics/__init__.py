"""Equilibria: load steps, paths, buckling, and equilibrium over time."""
