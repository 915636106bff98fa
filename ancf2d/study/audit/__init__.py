"""Examination of an element type by computation: its basis, coordinates, formulation and quadrature."""
