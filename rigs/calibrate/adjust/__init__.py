"""From observations to lenses and poses: first values, bundle adjustment, robust steps."""
