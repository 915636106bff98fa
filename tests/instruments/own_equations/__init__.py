"""A solver for cases of beams and rigid bars that has no part of ancf2d, to compare ancf2d with."""
