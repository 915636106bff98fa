"""Element types as data: bases, nodal coordinates, shape functions and formulations (numpy only)."""
