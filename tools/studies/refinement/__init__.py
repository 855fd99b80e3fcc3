"""Cameras refined from images of flames, against known rigs and on a real plume."""
