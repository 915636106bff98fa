"""The examination of an element type: what its basis, coordinates, formulation and quadrature do, by computation."""
