"""The studies of ``tools/benchmark.py``: each measures one thing and returns plain rows."""

PARTS = (
    "projectors",
    "solvers",
    "skipping",
    "basis",
    "scaling",
    "startup",
    "mismatch",
    "training",
)
