"""Parallel search of many images; results do not depend on the number of threads."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import groupby

from rigs.calibrate.detect import _detection_cache
from rigs.calibrate.detect._charuco import find_charuco
from rigs.calibrate.detect._chessboard import find_chessboard
from rigs.calibrate.detect._circles import find_circles
from rigs.calibrate.detect._detection_cache import Entry
from rigs.calibrate.detect.found import Found, Search
from rigs.calibrate.detect.image_sets import Source, VideoFrame, read_pictures, read_source
from rigs.calibrate.targets import CharucoBoard, Chessboard
from rigs.calibrate.targets.boards import Target

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
    keys = [_detection_cache.key(f"{target} {layouts}", *job) for job in jobs]
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
