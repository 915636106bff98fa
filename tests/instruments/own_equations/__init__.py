"""An independent solver for cases of beams and rigid bars, for comparison with ancf2d."""
