"""The compiled code: element force and tangent, assembly, band factorisation (the only numba in the project)."""
