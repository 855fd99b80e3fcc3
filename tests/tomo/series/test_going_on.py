import errno
import os
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr.storage._local as local_store

from tomo import Options, Scan
from tomo.series import reconstruct_series
from tomo.series import run as series_run
from tomo.series.frames import BLOCK, blocks_of
from tomo.series.layout import CAMERA_FIGURES, FIGURES
from tomo.series.run import run_plan
from tomo.series.same_run import Claims

pytestmark = pytest.mark.usefixtures("quick_choices")

ROOT = Path(__file__).parents[3]


class StoppedError(Exception):
    """The run ended here."""


@pytest.fixture
def stop_after(monkeypatch):
    """Return a function: let the write of so many files succeed, and the next one end the run."""
    put = local_store._put

    def arm(count):
        left = [count]

        def counted(path, *arguments, **settings):
            if left[0] == 0:
                raise StoppedError
            left[0] -= 1
            return put(path, *arguments, **settings)

        monkeypatch.setattr(local_store, "_put", counted)

    yield arm
    monkeypatch.setattr(local_store, "_put", put)


def test_a_run_that_ends_again_and_again_goes_on_to_the_same_bits(
    plan, store, undisturbed, stop_after, assert_same
):
    done = []
    block = BLOCK + len(FIGURES) + len(CAMERA_FIGURES) + 1  # files: volumes, figures, its record
    for count in (3, 14, block, 8):
        stop_after(count)
        with pytest.raises(StoppedError):
            run_plan(plan, store)
        complete = store.complete
        for place in np.flatnonzero(complete):
            assert np.array_equal(store.volume(place), undisturbed.volume(place))
        done.append(int(complete.sum()))
    assert done == [0, 0, 8, 8]
    stop_after(-1)
    run_plan(plan, store)
    assert_same(store, undisturbed)


def test_a_finished_store_is_left_as_it_is(film, undisturbed, monkeypatch):
    monkeypatch.setattr(series_run, "solve_block", None)
    before = {p: p.stat().st_mtime_ns for p in undisturbed.path.rglob("*") if p.is_file()}
    reconstruct_series(film.scan, undisturbed.path, options=film.options)
    after = {p: p.stat().st_mtime_ns for p in undisturbed.path.rglob("*") if p.is_file()}
    assert before == after


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"frames": "0:9"}, "options.frames: found ':' in the store, and now '0:9'"),
        ({"iterations": 7}, "options.iterations: found None in the store, and now 7"),
        ({"hold_out": ()}, "options.hold_out: found ['cam02'] in the store, and now []"),
        ({"key_frames": 3}, "options.key_frames: found 2 in the store, and now 3"),
    ],
)
def test_other_options_are_refused_with_what_differs(film, undisturbed, change, part):
    options = Options.from_mapping({**film.options.to_mapping(), **change})
    with pytest.raises(ValueError, match="made by another run") as caught:
        reconstruct_series(film.scan, undisturbed.path, options=options)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_another_scan_rig_or_grid_is_refused(film, undisturbed):
    brighter = Scan.from_arrays(
        film.rig, {name: 1.1 * images for name, images in film.images.items()}, film.grid
    )
    with pytest.raises(ValueError, match=r"scan\.key_images"):
        reconstruct_series(brighter, undisturbed.path, options=film.options)
    cameras = [camera.shifted(0.01, 0) for camera in film.rig]
    moved = replace(film.rig, cameras=tuple(cameras))
    scan = Scan.from_arrays(moved, film.images, film.grid)
    with pytest.raises(ValueError, match=r"rig\.cameras"):
        reconstruct_series(scan, undisturbed.path, options=film.options)
    grid = type(film.grid)((12, 14, 12), 1.01)
    with pytest.raises(ValueError, match=r"grid\.spacing"):
        reconstruct_series(film.scan, undisturbed.path, grid, options=film.options)


def test_a_store_of_another_version_is_refused(film, undisturbed, monkeypatch):
    monkeypatch.setattr(
        "tomo.series.same_run.versions", lambda: {"flametomo": "99", "numpy": np.__version__}
    )
    with pytest.raises(ValueError, match=r"versions\.flametomo"):
        reconstruct_series(film.scan, undisturbed.path, options=film.options)


def test_what_is_no_store_is_refused(film, tmp_path):
    (tmp_path / "folder.zarr").mkdir()
    with pytest.raises(ValueError, match=r"folder\.zarr: not a Zarr v3 group"):
        reconstruct_series(film.scan, tmp_path / "folder.zarr", options=film.options)


def test_two_runs_share_the_blocks_of_a_store(plan, store, undisturbed, assert_same):
    """A block that another process has in hand is left to it, and done if it ends before."""
    first, last = blocks_of(len(plan.places))
    code = (
        "import sys; from pathlib import Path; from tomo.series.same_run import Claims\n"
        "claims = Claims(Path(sys.argv[1]))\n"
        f"print(claims.take(range({last.start}, {last.stop}), wait=False), flush=True)\n"
        "sys.stdin.read()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(store.path)],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert other.stdout.readline() == "True\n"
        with closing(Claims(store.path)) as claims:
            assert claims.take(first, wait=False)
            assert not claims.take(last, wait=False)
            claims.release(first)
        seen = []

        def watch(done, total, where):
            seen.append(where)
            if done == len(first) and other.poll() is None:
                other.stdin.close()  # it ends without a result
                other.wait()

        run_plan(plan, store, watch)
    finally:
        other.kill()
    assert_same(store, undisturbed)


def test_a_store_that_does_not_fit_on_the_disk_is_refused(film, tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("tomo.series.run.shutil.disk_usage", lambda _: usage)
    with pytest.raises(OSError, match="GB free, expected"):
        reconstruct_series(film.scan, tmp_path / "out.zarr", options=film.options)
    assert not (tmp_path / "out.zarr").exists()


def test_a_disk_that_becomes_full_is_one_line_and_the_run_goes_on(
    film, plan, undisturbed, tmp_path, monkeypatch, assert_same
):
    monkeypatch.setattr(series_run, "make_plan", lambda scan, *_: replace(plan, scan=scan))
    put, path = local_store._put, tmp_path / "out.zarr"

    def full(file, *arguments, **settings):
        if file.relative_to(path.parent).parts[1:4] == ("emission", "c", "9"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))
        return put(file, *arguments, **settings)

    monkeypatch.setattr(local_store, "_put", full)
    with pytest.raises(
        OSError, match="No space left on device; 8 of 11 frames are complete"
    ) as no:
        reconstruct_series(film.scan, path, options=film.options)
    assert no.value.filename == str(path)
    monkeypatch.setattr(local_store, "_put", put)
    assert_same(reconstruct_series(film.scan, path, options=film.options), undisturbed)
