"""Self-calibration: refinement of poses, focal lengths and gains, where it is asked for."""
