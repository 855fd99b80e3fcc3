"""Rigs that come with the package."""
