"""The projector without a stored matrix: segment lengths are computed at every product."""
