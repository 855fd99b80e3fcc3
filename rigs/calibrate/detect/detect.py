"""Detection of a target's points in the images of one or more cameras."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect._charuco import other_counts, other_dictionary
from rigs.calibrate.detect._chessboard import counted_chessboard
from rigs.calibrate.detect._detection_run import (
    Entry,
    Job,
    find,
    read_cache,
    search_images,
    write_cache,
)
from rigs.calibrate.detect.found import Found, Search
from rigs.calibrate.detect.image_sets import Source, read_source
from rigs.calibrate.observations import Observations
from rigs.calibrate.targets import CharucoBoard, Chessboard
from rigs.calibrate.targets.boards import Target

_EXAMPLES = 8  # images that are searched for another target; more take seconds
ImageSet = Mapping[str, Mapping[str, Source]]
"""Images by camera and by frame, as `rigs.calibrate.detect.image_set` gives them."""


@dataclass(frozen=True, eq=False, repr=False)
class Detections:
    """Detections in a set of images.

    Parameters
    ----------
    observations : Observations
    blur : (cameras, frames) float64
        Blur of the target's edges, standard deviation in pixels; NaN where the target was not
        found. About 0.5 to 1 is sharp.
    reasons : dict of (camera, frame) to str
        For images without the target: what was found instead.
    """

    observations: Observations
    blur: NDArray[np.float64]
    reasons: dict[tuple[str, str], str]

    def __repr__(self) -> str:
        return f"<Detections: {self.observations!r}, {len(self.reasons)} images without target>"

    def blurred(self) -> tuple[tuple[str, str, float], ...]:
        """Return camera, frame and blur of images blurred twice as much as usual or more.

        Usual is the median over the camera's images, at least one pixel.
        """
        usual = np.full(len(self.blur), np.nan)
        for camera, row in enumerate(self.blur):
            if np.isfinite(row).any():
                usual[camera] = max(np.nanmedian(row), 1.0)
        with np.errstate(invalid="ignore"):
            where = np.argwhere(self.blur > 2 * usual[:, None])
        names = self.observations
        return tuple(
            (names.cameras[camera], names.frames[frame], float(self.blur[camera, frame]))
            for camera, frame in where
        )


def find_target(image: NDArray, target: Target) -> Found:
    """Return the detection of the target in one grey image ``(rows, columns)``.

    Returns
    -------
    found : Found
        ``point`` (points,) and ``uv`` (points, 2), pixel centres at integers; ``blur``; and
        ``reason``, a text, where nothing was found.
    """
    return find(Search.of(image), target)


def observe(
    images: ImageSet,
    target: Target,
    *,
    cache: str | os.PathLike | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> Observations:
    """Return the observations of a target in every image; see `detections`."""
    return detections(images, target, cache=cache, progress=progress, workers=workers).observations


def detections(
    images: ImageSet,
    target: Target,
    *,
    cache: str | os.PathLike | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> Detections:
    """Find the points of a target in every image.

    Corners of squares are measured by fitting a model of the blurred corner. Centres of circles
    are measured by fitting ellipses to edges, corrected for the shift of an ellipse's centre by
    perspective. A chessboard or circle grid must be complete; any part of a ChArUco board will do.

    Parameters
    ----------
    images : mapping of camera to mapping of frame to source
        Files, pictures of videos or arrays, as `image_set` gives them. Images of one frame show
        the target at rest in one pose.
    target : Chessboard, CharucoBoard or CircleGrid
    cache : path-like, optional
        A file (.npz) that keeps detections. An image is searched again when its path, size or time
        of change, or the target, differs.
    progress : callable, optional
        Called with the numbers of images done and of all images.
    workers : int, optional
        Number of threads, by default that of cores. Results do not depend on it.

    Raises
    ------
    ValueError
        In one line: an image that cannot be read, images of one camera that differ in size, a
        camera that never sees the target, several cameras and a target whose pose is ambiguous,
        a cache that is another kind of file.
    """
    if not images:
        raise ValueError("images: found no cameras, expected at least one")
    for camera, frames in images.items():
        if not frames:
            raise ValueError(f"camera {camera}: found no images, expected at least one")
    if len(images) > 1 and target.ambiguity:
        raise ValueError(
            f"target: found {target}, which does not determine the cameras' relative poses: "
            f"{target.ambiguity}; expected another target, or one camera at a time"
        )
    if workers is not None and workers < 1:
        raise ValueError(f"workers: found {workers}, expected at least 1")
    jobs = [
        (camera, frame, images[camera][frame]) for camera in images for frame in images[camera]
    ]
    known = {} if cache is None else read_cache(Path(cache))
    used: dict[str, Entry] = {}
    try:
        entries = search_images(jobs, target, True, known, used, progress, workers)
        settled = _layout(target, entries)
        if settled is not None:
            again = [
                job
                for job, (found, _) in zip(jobs, entries, strict=True)
                if len(found.point) and _legacy(found, target) != settled.legacy
            ]
            second = iter(search_images(again, settled, False, known, used, None, workers))
            redone = {(camera, frame) for camera, frame, _ in again}
            entries = [
                next(second) if job[:2] in redone else entry
                for job, entry in zip(jobs, entries, strict=True)
            ]
    finally:
        if cache is not None and used.keys() - known.keys():
            write_cache(Path(cache), known | used)
    _check_sizes(jobs, entries)
    _check_seen(jobs, entries, target)
    return _collect(images, jobs, entries, target)


def _legacy(found: Found, target: CharucoBoard) -> bool:
    return target.legacy if found.legacy is None else found.legacy


def _layout(target: Target, entries: list[Entry]) -> CharucoBoard | None:
    """Return the target in the layout that most images show; None if all agree."""
    if not isinstance(target, CharucoBoard):
        return None
    seen = [found for found, _ in entries if len(found.point)]
    counts = Counter(found.legacy for found in seen if found.legacy is not None)
    if not counts:
        return None
    legacy = max((target.legacy, not target.legacy), key=lambda layout: counts[layout])
    if all(_legacy(found, target) == legacy for found in seen):
        return None
    return replace(target, legacy=legacy)


def _check_sizes(jobs: list[Job], entries: list[Entry]) -> None:
    first: dict[str, tuple[Source, tuple[int, int]]] = {}
    for (camera, frame, source), (_, size) in zip(jobs, entries, strict=True):
        other, expected = first.setdefault(camera, (_name(source, frame), size))
        if size != expected:
            raise ValueError(
                f"camera {camera}: {_name(source, frame)}: found {size[0]}x{size[1]} pixels, "
                f"expected {expected[0]}x{expected[1]} as in {other}"
            )


def _check_seen(jobs: list[Job], entries: list[Entry], target: Target) -> None:
    """Refuse a camera that never saw the target; the message says what its images show."""
    for camera in dict.fromkeys(job[0] for job in jobs):
        own = [k for k, job in enumerate(jobs) if job[0] == camera]
        if any(len(entries[k][0].point) for k in own):
            continue
        reasons = Counter(entries[k][0].reason for k in own)
        usual = max(reasons, key=lambda reason: reasons[reason])
        typical = [k for k in own if entries[k][0].reason == usual]
        _, frame, source = jobs[typical[0]]
        spread = np.linspace(0, len(typical) - 1, min(len(typical), _EXAMPLES)).astype(int)
        instead = _instead([read_source(jobs[typical[k]][2]) for k in spread], target)
        raise ValueError(
            f"camera {camera}: {_name(source, frame)}: found {instead or usual}, expected "
            f"{target}, which none of its {len(own)} images shows"
        )


def _instead(images: list[NDArray], target: Target) -> str | None:
    """Return a similar target that most images show instead, or None."""
    if isinstance(target, Chessboard):
        return _other_chessboard(images, target)
    search = Search.of(images[0])
    if len(find(search.mirrored(), target).point):
        return "the target mirrored"
    if not isinstance(target, CharucoBoard):
        return None
    others = (other_counts(Search.of(image), target) for image in images)
    sizes = Counter(size for size in others if size is not None)
    if sizes:
        columns, rows = max(sizes, key=lambda size: sizes[size])
        other = replace(target, columns=columns, rows=rows)
        own = f"{target.columns}x{target.rows}"
        return f"markers of a board of {columns}x{rows} squares, not {own} (say {other})"
    name = other_dictionary(search, target)
    return name and f"markers of {name}"


def _other_chessboard(images: list[NDArray], target: Chessboard) -> str | None:
    """Return the commonest size of the boards in some images in words; whole boards go first."""
    boards = (counted_chessboard(Search.of(image)) for image in images)
    counted = [board for board in boards if board is not None]
    whole = [size for size, is_whole in counted if is_whole]
    sizes = Counter(whole or [size for size, _ in counted])
    if not sizes:
        return None
    columns, rows = max(sizes, key=lambda size: sizes[size])
    other = replace(target, columns=columns, rows=rows)
    if other == target:
        return None
    certain = f"in {sizes[columns, rows]} of {len(images)} images looked at"
    found = f"a chessboard of {columns}x{rows} inner corners {certain}"
    return f"{found} (say {other})" if whole and not other.ambiguity else found


def _name(source: Source, frame: str) -> str:
    return f"frame {frame}" if isinstance(source, np.ndarray) else str(source)


def _collect(
    images: ImageSet, jobs: list[Job], entries: list[Entry], target: Target
) -> Detections:
    cameras = tuple(images)
    longest = max(images.values(), key=len)
    # The order of a camera that has every frame is kept, else names are sorted
    frames = tuple(dict.fromkeys([*longest, *(name for own in images.values() for name in own)]))
    if len(frames) > len(longest):
        frames = tuple(sorted(frames))
    index_of = {name: k for k, name in enumerate(frames)}
    blur = np.full((len(cameras), len(frames)), np.nan)
    parts: list[tuple[NDArray, ...]] = []
    reasons, sizes = {}, {}
    for (camera, frame, _), (found, size) in zip(jobs, entries, strict=True):
        sizes[camera] = size
        row, column = cameras.index(camera), index_of[frame]
        blur[row, column] = found.blur
        if not len(found.point):
            reasons[camera, frame] = found.reason
        index = np.full((len(found.point), 2), (row, column))
        parts.append((index[:, 0], index[:, 1], found.point, found.uv))
    columns = [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
    observations = Observations(
        target.points, cameras, tuple(sizes[name] for name in cameras), frames, *columns
    )
    return Detections(observations, blur, reasons)
