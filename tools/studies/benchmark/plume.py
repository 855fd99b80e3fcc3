"""ScalarFlow's fog: each camera predicted from the four others, by the default and by `wernet`.

Left out where `--data` holds no `scalarflow` folder. Times are since the images were in memory,
choosing and tracing included.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.common.scans import reconstructed, seconds_of
from studies.common.study import Request, Tables
from studies.scenes.scene import warm_up
from tomo import Scan, VoxelGrid, load_scan

SCAN = Path("scalarflow") / "transforms.json"
JUDGED = "cam02"
"""The field's held-out camera: the only one that is also predicted without skipping."""

WAYS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "nothing left out": {"skip": False},
    "wernet": {"method": "wernet"},
}
"""Options of each; without leaving out for `JUDGED` alone."""

LOWER, UPPER = (0.0818, -0.0446, -0.4958), (0.5727, 0.6917, -0.0049)


def run(request: Request) -> Tables:
    """Return both frames' five leave-one-out views; with fewer sizes one frame's two."""
    if request.data is None or not (request.data / SCAN).is_file():
        return {"plume": []}
    warm_up()
    full = request.size == "full"
    scan = load_scan(request.data / SCAN).scaled(6 if full else 12)
    grid = VoxelGrid.from_bounds((64, 96, 64) if full else (32, 48, 32), LOWER, UPPER)
    frames = scan.frame_names if full else scan.frame_names[-1:]
    cameras = scan.rig.names if full else [JUDGED, scan.rig.names[0]]
    cases = [
        (frame, camera, way)
        for frame, camera, way in itertools.product(frames, cameras, WAYS)
        if camera == JUDGED or WAYS[way].get("skip", True)
    ]
    said = "plume, {0[0]} without {0[1]}".format
    return {"plume": [_predicted(scan, grid, *case) for case in request.each(cases, said)]}


def _predicted(scan: Scan, grid: VoxelGrid, frame: str, camera: str, way: str) -> dict[str, Any]:
    how = {"frame": frame, "hold_out": [camera], "peak": 1.0, **WAYS[way]}
    outcome = reconstructed(scan, grid, **how)
    return {
        "frame": frame,
        "held_out": camera,
        "way": way,
        **outcome.report()["held_out"][camera],
        "seconds": seconds_of(outcome),
        "segments": outcome.counts["segments"],
        "live_voxels": outcome.counts["active_voxels"],
    }
