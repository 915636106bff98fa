"""Motion over time: integrators, events, and the error of time steps."""
