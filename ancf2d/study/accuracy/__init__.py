"""Solving to a wanted accuracy: meshes, steps and element types that reach it at little cost, verified."""
