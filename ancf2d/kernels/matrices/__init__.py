"""Symmetric matrices of the unknowns and their factors: bands, fronts, compressed rows."""
