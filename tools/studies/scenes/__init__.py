"""Scenes that nobody tuned on: known fields, an independent forward model, and faults."""
