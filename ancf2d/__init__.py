"""ancf2d: planar flexible multibody dynamics with ANCF beam elements."""

__version__ = "0.1.0"
