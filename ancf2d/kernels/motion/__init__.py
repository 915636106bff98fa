"""The equations of motion and their time steps."""
