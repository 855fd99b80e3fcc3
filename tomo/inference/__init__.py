"""Voxels and effects found together, and what is said about them."""
