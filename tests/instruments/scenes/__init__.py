"""Random valid scenes, transformations that must not change the result, and checks of the results."""
