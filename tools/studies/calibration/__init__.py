"""Calibration from rendered boards against known rigs, and against OpenCV."""
