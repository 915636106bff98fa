"""Compiled code: element forces and tangents, assembly, factorisation, time steps; the only numba in the project."""
