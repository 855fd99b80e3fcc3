"""Running a series: frames are read ahead, solved block by block, and written behind."""

from __future__ import annotations

import errno
import gc
import itertools
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigs import Rig
from rigs.progress import FRAMES, Progress, progress_of
from tomo.grid import VoxelGrid
from tomo.operators.gpu import DeviceError
from tomo.pipeline.options import Options
from tomo.pipeline.screen import FrameImages
from tomo.scan import Scan
from tomo.scan.files import as_scan
from tomo.series.frames import BLOCK, blocks_of, choose_frames, reader_of
from tomo.series.layout import mend_descriptions
from tomo.series.overlap import read_ahead, write_behind
from tomo.series.plan import Plan, system_of_block
from tomo.series.same_run import (
    Claims,
    attributes_of_plan,
    attributes_of_run,
    check_same_run,
    mend,
)
from tomo.series.settle import check_series_options, make_plan
from tomo.series.solving import (
    SKIPPED,
    FrameResult,
    solve_filtered,
    solve_frame,
    solve_together,
)
from tomo.series.store import SeriesStore

if TYPE_CHECKING:
    from os import PathLike

Execute = Callable[[Plan, SeriesStore, Progress | None], None]
"""Solves every block that is not complete, like `run_plan`."""


def reconstruct_series(
    scan: Scan | str | PathLike | Mapping[str, Any],
    path: str | PathLike,
    grid: VoxelGrid | None = None,
    options: Options = Options(frames=":"),
    *,
    rig: Rig | str | PathLike | None = None,
    progress: Progress | bool | None = None,
    cluster: AbstractContextManager[Execute] | None = None,
    **asked: Any,
) -> SeriesStore:
    """Reconstruct many frames of a scan into a store; go on with one that was begun.

    Parameters
    ----------
    scan : Scan, path-like, or mapping
        Also the path of one; or with ``rig`` a folder of images, or camera to ``(frames, h, w)``.
    path : path-like
        The store. One that the same scan, options and version began is finished, to the same
        bits; what is damaged in it is done again. Several runs may work on one at once.
    grid : VoxelGrid, optional
        The scan's own when None.
    options : Options
        ``frames`` are those to reconstruct.
    rig : Rig or path-like, optional
        The cameras of images.
    progress : bool or callable, optional
        True shows a bar; ``progress(done, total, where)`` is called, see `rigs.progress`.
    cluster : context manager, optional
        Gives what solves the blocks that are missing, see `tomo.series.cluster.on_cluster`; this
        process does when None.
    **asked
        Single options, such as ``frames="0:100"``, in place of those of ``options``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input, or what differs from the store's.
    OSError
        If the store does not fit on the disk, before the first frame or when that is full. Frames
        that are complete stay.
    """
    options, scan = options.but(**asked), as_scan(scan, rig, grid)
    grid = scan.grid if grid is None else grid
    check_series_options(options, scan, grid)
    places = choose_frames(scan, options.frames or ":")
    if not options.skip_bad:
        _check_images(scan, places)
    attributes = attributes_of_run(scan, grid, options, places)
    rate = scan.frame_rate or 1.0
    times = [place / rate for place in places]
    known = None
    if Path(path).exists():
        mend_descriptions(Path(path), times, places)
        known = SeriesStore(path)
        check_same_run(known, attributes)
        with progress_of(progress, "check") as tell:
            mend(known, times, places, tell)
        if known.finished:
            return known
    with (
        cluster or nullcontext(run_plan) as execute,
        progress_of(progress, FRAMES) as tell,
    ):
        plan = make_plan(scan, grid, options, places, tell)
        attributes |= attributes_of_plan(plan)
        if known is None:
            _check_room(Path(path), plan)
            known = SeriesStore.create(path, grid, times, places, attributes)
        check_same_run(known, attributes)
        with _failures_in_one_line(known):
            execute(plan, known, tell)
    return known


def run_plan(plan: Plan, store: SeriesStore, progress: Progress | None = None) -> None:
    """Solve and write every block that is not complete and that no other run has in hand."""
    blocks = blocks_of(len(plan.places))
    with closing(Claims(store.path)) as claims:
        for wait in (False, True):  # at last for blocks of other runs, which may end before them
            missing = [block for block in blocks if not store.is_complete(block)]
            run_blocks(plan, store, claims, missing, wait, progress)
    if progress:
        progress(len(plan.places), len(plan.places), "")


def run_blocks(
    plan: Plan,
    store: SeriesStore,
    claims: Claims,
    blocks: list[range],
    wait: bool,
    progress: Progress | None,
) -> None:
    """Solve and write those of some blocks that can be had: that are not in another run's hand."""
    read = reader_of(plan.scan, plan.screened, plan.options.skip_bad)

    def in_turn() -> Iterator[tuple[range, FrameImages | None]]:
        for block in blocks:
            if not claims.take(block, wait=wait):
                continue
            if store.is_complete(block):  # by another run, since it was looked for
                claims.release(block)
                continue
            store.remove_partial(block)
            for place in plan.solved_with(block):
                yield block, read(plan.places[place])

    written: dict[range, list[tuple[int, FrameResult]]] = {}

    def write(item: tuple[range, int, FrameResult]) -> None:
        block, place, result = item
        if result.volume is not None:
            store.write_volume(place, result.volume)
        results = written.setdefault(block, [])
        results.append((place, replace(result, volume=None)))
        if len(results) == len(block):
            store.finish(block, [one for _, one in sorted(results, key=itemgetter(0))])
            claims.release(block)
            del written[block]

    done = len(plan.places) - sum(map(len, blocks))
    if progress:
        progress(done, len(plan.places), "")
    with read_ahead(in_turn(), BLOCK) as frames, write_behind(write) as put:
        while True:
            found = list(itertools.islice(frames, 1))
            if not found:
                break
            block = found[0][0]
            found += itertools.islice(frames, len(plan.solved_with(block)) - 1)
            for place, result in solve_block(plan, block, [images for _, images in found]):
                put((block, place, result))
                done += 1
                if progress:
                    name = plan.scan.frames[plan.places[place]].name
                    progress(done, len(plan.places), f"frame {name}")
            gc.collect()  # operators refer to their transposes: blocks would pile up in memory


def solve_block(
    plan: Plan, block: range, frames: Sequence[FrameImages | None]
) -> Iterator[tuple[int, FrameResult]]:
    """Yield the places of a block's frames and their results.

    ``frames`` are those that it is solved with (`Plan.solved_with`), None for one left out. A
    block can be done alone, anywhere and in any order, to the same bits.
    """
    both = zip(plan.solved_with(block), frames, strict=True)
    good = {place: one for place, one in both if one is not None}
    own = [place for place in block if place in good]
    yield from ((place, SKIPPED) for place in block if place not in good)
    if not own:
        return
    system = system_of_block(plan, list(good.values()))
    choice = plan.choice
    if choice is not None and plan.filter is not None:
        yield from solve_filtered(plan, system, own, good, choice, plan.filter)
        return
    results: Iterator[FrameResult]
    good = {place: good[place] for place in own}
    if choice is None:
        results = (solve_frame(plan, system, frame) for frame in good.values())
    else:
        results = solve_together(plan, system, list(good.values()), choice)
    yield from zip(good, results, strict=True)


def _check_images(scan: Scan, places: Sequence[int]) -> None:
    """Refuse frames that a camera has no image of, before any is read."""
    for place in places:
        frame = scan.frames[place]
        for camera in scan.rig.names:
            if camera not in frame.images:
                raise ValueError(
                    f"{scan.where}frame {frame.name!r}: camera {camera}: found no image, "
                    "expected one of every camera of the rig; skip_bad=True leaves such frames out"
                )


def _check_room(path: Path, plan: Plan) -> None:
    """Refuse a store whose active voxels, uncompressed, do not fit on the disk."""
    folder = path.absolute()
    while not folder.exists():
        folder = folder.parent
    needed = len(plan.places) * plan.system.active.size * np.dtype(np.float32).itemsize
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"found {free / 1e9:.3g} GB free, expected {needed / 1e9:.3g} GB for "
            f"{len(plan.places)} frames",
            str(path),
        )


@contextmanager
def _failures_in_one_line(store: SeriesStore) -> Iterator[None]:
    """Say of a disk that is full, and of a device that was lost, which frames stay."""
    try:
        yield
    except DeviceError as error:
        raise DeviceError(
            f"{store.path}: {error}; {store.done()}: the same command goes on"
        ) from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise OSError(
            error.errno,
            f"{error.strerror}; {store.done()}: make room, and give the same command again",
            str(store.path),
        ) from None
