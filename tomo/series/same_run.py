"""Whether a run may go on with a store, who has which of its blocks, and what is damaged in it.

What the store was made from and with is compared. Claims are locks that end with their process.
"""

from __future__ import annotations

import logging
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rigs.files.write_rig import rig_to_yaml
from rigs.progress import Progress
from tomo.grid import VoxelGrid
from tomo.pipeline.options import Options
from tomo.pipeline.report_json import plain, versions
from tomo.scan import Scan
from tomo.scan.films import FilmFrame
from tomo.scan.image_source import MeanImage
from tomo.series.frames import BLOCK, blocks_of, naming, readable_keys
from tomo.series.plan import Plan
from tomo.series.store import SeriesStore

COMPARED = ("grid", "rig", "options", "scan", "block", "plan")
"""Attributes that decide the bits of a volume."""

COMPARED_VERSIONS = ("flametomo", "numpy", "numba", "scipy")
"""Packages whose other versions may round otherwise."""


def attributes_of_run(
    scan: Scan, grid: VoxelGrid, options: Options, places: Sequence[int]
) -> dict[str, Any]:
    """Return the attributes of a store that are known before the plan is made."""
    rate, keys = scan.frame_rate, readable_keys(scan, places, options)
    return plain(
        {
            # a run that a bad frame ended goes on with --skip-bad: good frames have the same bits
            "options": replace(options, skip_bad=False).to_mapping(),
            "scan": {
                "frames": [scan.frames[place].name for place in places],
                "scale": scan.shrink,
                "frame_rate": rate,
                "corrections": _corrections(scan),
                "per_count": scan.per_count,
                "key_images": _checksum(scan.without(*options.hold_out), keys),
            },
            "source": None if scan.source is None else str(Path(scan.source).absolute()),
            "origin": dict(scan.origin),
            "rig": yaml.safe_load(rig_to_yaml(scan.rig)),
            "grid": grid.to_mapping(),
            "block": BLOCK,
            "cameras": list(scan.rig.names),
            "length_unit": scan.rig.length_unit,
            "value_unit": scan.value_unit(scan.frames[keys[0]].name),
            "time_unit": "1" if rate is None else "s",
            "versions": versions(),
        }
    )


def attributes_of_plan(plan: Plan) -> dict[str, Any]:
    """Return the attributes of a store that say what was settled for all frames."""
    moved = plan.screened.refinement
    found = moved and moved.recorded_rig(plan.scan)
    return plain(
        {
            "plan": plan.report(),
            "plan_warnings": list(plan.warnings),
            "place": plan.system.built.place,
            "corrected_rig": found and yaml.safe_load(rig_to_yaml(found)),
        }
    )


def check_same_run(store: SeriesStore, attributes: Mapping[str, Any]) -> None:
    """Refuse a store that another scan, rig, version or other options made."""
    known = store.attributes
    pairs = [(name, known.get(name), attributes[name]) for name in COMPARED if name in attributes]
    if "versions" in attributes:
        theirs, ours = known.get("versions") or {}, attributes["versions"]
        pairs += [(f"versions.{n}", theirs.get(n), ours.get(n)) for n in COMPARED_VERSIONS]
    for name, found, wanted in pairs:
        for where, one, other in _differences(name, found, wanted):
            raise ValueError(
                f"{store.path}: {where}: found {_short(one)} in the store, and now "
                f"{_short(other)}: it was made by another run. Go on as it was begun, or write "
                "another store"
            )


def _differences(where: str, one: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the place and both values of what differs, the innermost first."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            yield from _differences(f"{where}.{key}", one.get(key), other.get(key))
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for place, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _differences(f"{where}[{place}]", a, b)
    elif one != other:
        yield where, one, other


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ... ({len(text)} characters)"


def _corrections(scan: Scan) -> dict[str, Any]:
    """Return the corrections, images of them by their check sums."""

    def each(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {name: each(one) for name, one in value.items()}
        if isinstance(value, MeanImage):
            return [each(one) for one in value.images]
        if isinstance(value, FilmFrame):
            return each(value.read())
        if isinstance(value, Path):
            return f"{value.name}: {zlib.crc32(value.read_bytes())}"
        if isinstance(value, np.ndarray):
            return zlib.crc32(np.ascontiguousarray(value).tobytes())
        return value

    return {name: each(value) for name, value in vars(scan.corrections).items()}


def _checksum(scan: Scan, places: Sequence[int]) -> int:
    """Return a check sum of the images of some frames, corrected."""
    found = 0
    for place in places:
        frame = scan.frames[place].name
        with naming(frame):
            images = scan.images(frame)
        for image in images:
            found = zlib.crc32(np.ascontiguousarray(image).tobytes(), found)
    return found


LOCK = Path("complete") / "lock"
"""The file whose bytes are locked, one a block, in a store's folder: inside an array, where no
reader of the store looks for groups."""


class Claims:
    """The blocks of a store that this process has in hand, for one run at a time.

    Where parts of files cannot be locked (Windows, some network disks), every process gets every
    block: all write the same.
    """

    def __init__(self, store: Path) -> None:
        self._system: Any = None
        with suppress(ImportError):
            import fcntl

            self._system = fcntl
        # one handle: POSIX takes all locks of a process away when it closes any handle of a file
        self._handle = os.open(store / LOCK, os.O_RDWR | os.O_CREAT, 0o666)

    def close(self) -> None:
        """Let all blocks go."""
        os.close(self._handle)

    def take(self, block: range, *, wait: bool) -> bool:
        """Take a block, or wait for the process that has it; return whether it could be had."""
        if self._system is None:
            return True
        how = self._system.LOCK_EX | (0 if wait else self._system.LOCK_NB)
        try:
            self._system.lockf(self._handle, how, 1, block.start)
        except (BlockingIOError, PermissionError):
            return False
        except OSError:  # a disk without locks
            return True
        return True

    def release(self, block: range) -> None:
        """Give a block back."""
        if self._system is not None:
            self._system.lockf(self._handle, self._system.LOCK_UN, 1, block.start)


logger = logging.getLogger(__name__)


def mend(
    store: SeriesStore,
    times: Sequence[float],
    frames: Sequence[int],
    progress: Progress | None = None,
) -> None:
    """Read a store through; write coordinates and have a run do again frames that are damaged.

    Frames beside them stay complete. A block that another run has in hand is left to it.
    """
    grid = VoxelGrid(**store.attributes["grid"])
    expected = {"time": times, "frame": frames, **dict(zip("xyz", grid.axes(), strict=True))}
    for name, values in expected.items():
        try:
            if np.array_equal(store.values(name), values):
                continue
            line = f"{store.path}: {name}: found other values than this run's; written again"
        except ValueError as error:
            line = str(error)
        logger.warning("%s", line)
        store.write_coordinates(name, values)
    damaged = []
    for block in blocks_of(store.n_frames):
        if progress:
            progress(block.start, store.n_frames, "reading what is there")
        if store.damage(block):
            damaged.append(block)
    if progress:
        progress(store.n_frames, store.n_frames, "")
    if not damaged:  # nothing is written: the store may be on a disk that allows none
        return
    with closing(Claims(store.path)) as claims:
        for block in damaged:
            if not claims.take(block, wait=False):
                continue
            found = store.damage(block)  # another run may have done it again since
            if found:
                store.forget(block, found)
            for line in dict.fromkeys(found.values()):
                logger.warning("%s", line)
            claims.release(block)
