"""Parallel search of many images, each once: a file caches what was found.

Results do not depend on the number of threads.
"""

from __future__ import annotations

import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect._charuco import find_charuco
from rigs.calibrate.detect._chessboard import find_chessboard
from rigs.calibrate.detect._circles import find_circles
from rigs.calibrate.detect.found import Found, Search
from rigs.calibrate.detect.image_sets import (
    MosaicImage,
    Source,
    VideoFrame,
    read_pictures,
    read_source,
)
from rigs.calibrate.targets import CharucoBoard, Chessboard
from rigs.calibrate.targets.boards import Target
from rigs.files import atomic_path
from rigs.files.size_guard import errors_of_libraries, read_arrays

_FORMAT = "target detections 1"  # a new number when the search's results change

Entry = tuple[Found, tuple[int, int]]
"""The detection, and the image's width and height."""

Job = tuple[str, str, Source]
"""Camera, frame and image."""


def search_images(
    jobs: list[Job],
    target: Target,
    both_layouts: bool,
    known: Mapping[str, Entry],
    used: dict[str, Entry],
    progress: Callable[[int, int], None] | None,
    workers: int | None,
) -> list[Entry]:
    """Return the detection of each image; each is also put into ``used`` when done."""
    layouts = "either layout" if both_layouts else "one layout"
    keys = [cache_key(f"{target} {layouts}", *job) for job in jobs]
    left = [job for job, name in zip(jobs, keys, strict=True) if name not in known]
    names = iter([name for name in keys if name not in known])
    used.update((name, known[name]) for name in keys if name in known)
    done = len(jobs) - len(left)
    if progress is not None and jobs:
        progress(done, len(jobs))
    count = workers or os.cpu_count() or 1
    waiting: deque[Future[Entry]] = deque()
    with ThreadPoolExecutor(count) as pool:
        try:
            submitted = _submitted(pool, left, target, both_layouts)
            while True:
                future = next(submitted, None)
                if future is not None:
                    waiting.append(future)
                # Decoded video frames wait in memory, so few may be queued
                while waiting and (future is None or len(waiting) > 3 * count):
                    used[next(names)] = waiting.popleft().result()
                    done += 1
                    if progress is not None:
                        progress(done, len(jobs))
                if future is None:
                    return [used[name] for name in keys]
        finally:
            for future in waiting:
                future.cancel()


def _submitted(pool, jobs: list[Job], target: Target, both_layouts: bool) -> Iterator[Future]:
    """Submit the images to the pool in order; each video is decoded here in one pass."""
    for (camera, path), group in groupby(
        jobs, key=lambda job: (job[0], job[2].path if isinstance(job[2], VideoFrame) else None)
    ):
        if path is None:
            for _, _, source in group:
                yield pool.submit(_examine, camera, source, target, both_layouts)
            continue
        wanted = [source.index for _, _, source in group if isinstance(source, VideoFrame)]
        pictures = read_pictures(path, wanted)
        while True:
            try:
                _, picture = next(pictures)
            except StopIteration:
                break
            except ValueError as error:
                raise ValueError(f"camera {camera}: {error}") from None
            yield pool.submit(_examine, camera, picture, target, both_layouts)


def _examine(camera: str, source: Source, target: Target, both_layouts: bool) -> Entry:
    try:
        image = read_source(source)
    except ValueError as error:
        raise ValueError(f"camera {camera}: {error}") from None
    return find(Search.of(image), target, both_layouts), image.shape[::-1]


def find(search: Search, target: Target, both_layouts: bool = True) -> Found:
    """Return the detection of a target of any kind in one image."""
    if isinstance(target, Chessboard):
        return find_chessboard(search, target)
    if isinstance(target, CharucoBoard):
        return find_charuco(search, target, both_layouts)
    return find_circles(search, target)


def cache_key(target: str, camera: str, frame: str, source: Source) -> str:
    """Return a text that changes when the target or the image does."""
    if isinstance(source, np.ndarray):
        content = np.ascontiguousarray(source)
        digest = hashlib.sha256(content.tobytes()).hexdigest()
        identity = f"{content.dtype} {content.shape} {digest}"
    else:
        path = Path(source.path if isinstance(source, VideoFrame | MosaicImage) else source)
        try:
            state = path.stat()
        except OSError as error:
            raise ValueError(
                f"camera {camera}: {path}: cannot be read: {error.strerror}"
            ) from None
        identity = f"{path.absolute()} {state.st_size} {state.st_mtime_ns}"
        if isinstance(source, VideoFrame):
            identity += f" {source.index}"
        elif isinstance(source, MosaicImage):
            identity += " mosaic"
    return "\n".join((target, camera, frame, identity))


def read_cache(path: Path) -> dict[str, Entry]:
    """Return the entries of a cache, if there is one; a file of another kind is refused."""
    if not path.exists():
        return {}
    kind = f"{path}: found another kind of file, expected a cache of detections or none"
    with errors_of_libraries(kind):
        stored = read_arrays(path)
        if str(stored["format"]) != _FORMAT:
            return {}
        return _entries(stored)


def _entries(stored: Mapping[str, NDArray]) -> dict[str, Entry]:
    """Return the entries of the arrays of a cache."""
    point, uv, size = (_numbers(stored[name]) for name in ("point", "uv", "size"))
    ends = np.cumsum(stored["counts"])
    if min(stored["counts"], default=0) < 0 or point.shape != (ends[-1] if len(ends) else 0,):
        raise ValueError("counts: found a sum that differs from the number of points")
    if uv.shape != (len(point), 2) or size.shape != (len(stored["keys"]), 2):
        raise ValueError(f"uv, size: found {uv.shape} and {size.shape}")
    if any(len(stored[name]) != len(size) for name in ("counts", "blur", "reason", "legacy")):
        raise ValueError("keys: found another number than of images")
    if not np.isfinite(uv).all() or (size < 1).any():
        raise ValueError("uv, size: found NaN, infinity or nothing")
    entries = {}
    for k, name in enumerate(stored["keys"].tolist()):
        rows = slice(int(ends[k] - stored["counts"][k]), int(ends[k]))
        legacy = {-1: None, 0: False, 1: True}[int(stored["legacy"][k])]
        blur, reason = float(stored["blur"][k]), str(stored["reason"][k])
        found = Found(point[rows].astype(np.int64), uv[rows].astype(float), blur, reason, legacy)
        entries[str(name)] = found, (int(size[k, 0]), int(size[k, 1]))
    return entries


def _numbers(array: NDArray) -> NDArray:
    if array.dtype.kind not in "iuf":
        raise ValueError(f"found {array.dtype}, expected numbers")
    return array


def write_cache(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write the entries under a temporary name in the same folder, then rename it."""
    found = [entry[0] for entry in entries.values()]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            format=np.array(_FORMAT),
            keys=np.array(list(entries), dtype=np.str_),
            counts=np.array([len(item.point) for item in found], np.int64),
            point=np.concatenate([np.zeros(0, np.int64), *(item.point for item in found)]),
            uv=np.concatenate([np.zeros((0, 2)), *(item.uv for item in found)]),
            blur=np.array([item.blur for item in found], np.float64),
            reason=np.array([item.reason for item in found], dtype=np.str_),
            legacy=np.array([-1 if i.legacy is None else int(i.legacy) for i in found], np.int64),
            size=np.array([entry[1] for entry in entries.values()], np.int64).reshape(-1, 2),
        )
