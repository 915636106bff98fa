"""Cases solved to a wanted accuracy beside their limits: what was reached, what was estimated, what it cost."""
