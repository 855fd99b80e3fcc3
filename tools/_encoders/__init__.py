"""Encoders that come with the package: what they are trained on, and how they transfer."""
