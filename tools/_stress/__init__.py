"""The stress test of ``tools/stress.py``: each area attacks one side of the toolkit."""

from collections.abc import Mapping

AREAS: Mapping[str, str] = {
    "geometry": "Geometry",
    "values": "Values",
    "scaling": "Scaling",
    "conditioning": "Conditioning",
    "threads": "Threads and repeats",
    "robustness": "Wild pixels and wrong views",
    "calibration": "Calibration error",
    "trust": "The condition report's standard deviations",
    "wernet": "WERNet",
    "machine": "The machine",
    "fuzzing": "Fuzzing of every reader",
}
"""The areas and their titles: ``_stress/<area>_area.py`` has the function ``rows``."""
