"""Self-calibration: shifts, poses, focal lengths and gains of cameras from the images alone."""
