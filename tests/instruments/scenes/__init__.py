"""Random valid scenes, transformations that must not matter, and checks of what ancf2d answers to both."""
