"""Reference solutions: geometrically exact beams by shooting and spectral elements, modes, motions, paths."""
