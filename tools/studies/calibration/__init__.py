"""Calibration from rendered boards against known rigs, and beside OpenCV."""
