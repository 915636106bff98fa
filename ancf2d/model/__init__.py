"""From a case to arrays: bodies, meshes, numbering, constraints and loads."""
