"""An interrupted run resumes to the same result."""

import signal
import subprocess
import sys
import zipfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch

from tomo.operators import Projector
from tomo.selection import choose
from tomo.trace import Segments
from tomo.wernet import WernetSettings, save_encoder
from tomo.wernet.default import CorrectionEncoder, wernet

pytestmark = pytest.mark.usefixtures("quick_choices")

SHADING = 0.4
ITERATIONS = 2
KILLED = """
import importlib.util, os, signal, sys
spec = importlib.util.spec_from_file_location("scenes", sys.argv[1])
scenes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(scenes)
import torch
from tomo.selection import choose
from tomo.wernet import wernet

def kill(index, volume, residual):
    if index == int(sys.argv[3]):
        os.kill(os.getpid(), signal.SIGKILL)

torch.set_num_threads(1)
choose.ENOUGH_BLOCKS = int(sys.argv[5])
one = scenes.make_scene(shading=0.4)
iterations = int(sys.argv[4])
wernet(one.projector, one.measured, iterations=iterations, callback=kill, checkpoint=sys.argv[2])
"""


class _InterruptedError(Exception):
    pass


@lru_cache
def _uninterrupted(make, shading=SHADING):
    one = make(shading=shading)
    return wernet(one.projector, one.measured, iterations=ITERATIONS)


def _interrupt_after(number):
    def callback(index, volume, residual):
        if index == number:
            raise _InterruptedError

    return callback


def _assert_same(found, expected, projector):
    np.testing.assert_array_equal(found.volume, expected.volume)
    assert found.settings == expected.settings
    assert found.relative_residual == expected.relative_residual
    assert (found.weights is None) == (expected.weights is None)
    if found.weights is not None:
        lengths = [r.weights.projector(projector).segments.length for r in (found, expected)]
        np.testing.assert_array_equal(*lengths)


@pytest.fixture
def checkpoint(tmp_path):
    return tmp_path / "deep" / "checkpoint.pt"


@pytest.fixture(scope="module")
def written(scene, tmp_path_factory):
    """Return the content of a checkpoint of one outer iteration."""
    one, path = scene(shading=SHADING), tmp_path_factory.mktemp("written") / "checkpoint.pt"
    wernet(one.projector, one.measured, iterations=1, checkpoint=path)
    return path.read_bytes()


@pytest.fixture
def present(checkpoint, written):
    """Return the path of such a checkpoint."""
    checkpoint.parent.mkdir()
    checkpoint.write_bytes(written)
    return checkpoint


def test_a_run_that_was_killed_goes_on_to_the_same_bits(scene, checkpoint):
    one = scene(shading=SHADING)
    scenes = Path(__file__).parent.with_name("conftest.py")
    numbers = map(str, (1, ITERATIONS, choose.ENOUGH_BLOCKS))
    command = [sys.executable, "-c", KILLED, scenes, checkpoint, *numbers]
    root = Path(__file__).parents[4]
    done = subprocess.run(command, cwd=root, capture_output=True, timeout=300, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]
    seen = []
    found = wernet(
        one.projector,
        one.measured,
        iterations=ITERATIONS,
        checkpoint=checkpoint,
        resume=True,
        callback=lambda index, volume, residual: seen.append(index),
    )
    assert seen[:2] == [0, 2]
    expected = _uninterrupted(scene)
    assert expected.weights is not None
    _assert_same(found, expected, one.projector)
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]


@pytest.mark.parametrize(("shading", "after"), [(SHADING, 0), (SHADING, ITERATIONS), (0.0, 1)])
def test_wherever_it_stopped_it_goes_on_to_the_same_bits(scene, checkpoint, shading, after):
    one = scene(shading=shading)
    arguments = {"iterations": ITERATIONS, "checkpoint": checkpoint}
    with pytest.raises(_InterruptedError):
        wernet(one.projector, one.measured, callback=_interrupt_after(after), **arguments)
    assert checkpoint.exists() == (after > 0)
    found = wernet(one.projector, one.measured, resume=True, **arguments)
    _assert_same(found, _uninterrupted(scene, shading), one.projector)
    indices = [entry.index for entry in found.history]
    assert indices == sorted(set(indices))


def test_a_run_that_had_settled_has_settled(scene, checkpoint):
    """Training that ended before its last outer iteration is not resumed."""
    one = scene()
    arguments = {"iterations": 8, "checkpoint": checkpoint}
    whole = wernet(one.projector, one.measured, **arguments)
    assert "iterations done" not in whole.stop_reason
    seen = []
    again = wernet(
        one.projector,
        one.measured,
        resume=True,
        callback=lambda index, volume, residual: seen.append(index),
        **arguments,
    )
    _assert_same(again, whole, one.projector)
    assert len(seen) <= 2


def test_without_resume_it_begins_anew(scene, checkpoint):
    one = scene(shading=SHADING)
    arguments = {"iterations": 1, "checkpoint": checkpoint}
    first = wernet(one.projector, one.measured, **arguments)
    seen = []
    second = wernet(
        one.projector,
        one.measured,
        callback=lambda index, volume, residual: seen.append(index),
        **arguments,
    )
    assert seen[:2] == [0, 1]
    _assert_same(second, first, one.projector)


def _other_images(one):
    return one.projector, one.measured * np.float32(1.5)


def _other_rays(one):
    s = one.projector.segments
    voxel = s.voxel.copy()
    voxel[:2] = voxel[1::-1]
    segments = Segments(s.ptr, voxel, s.length, s.midpoint)
    return Projector(segments, one.grid, one.projector.view_ptr), one.measured


def _other_lengths(one):
    s = one.projector.segments
    segments = Segments(s.ptr, s.voxel, 2 * s.length, s.midpoint)
    return Projector(segments, one.grid, one.projector.view_ptr), one.measured


def _other_views(one):
    view_ptr = one.projector.view_ptr.copy()
    view_ptr[1] -= 20
    return Projector(one.projector.segments, one.grid, view_ptr), one.measured


def _through_a_lens(one):
    return one.system.with_lens_blur(3.0).projector, one.measured


@pytest.mark.parametrize(
    "change", [_other_images, _other_rays, _other_lengths, _other_views, _through_a_lens]
)
def test_a_checkpoint_of_another_problem_is_refused(scene, present, written, change):
    one = scene(shading=SHADING)
    with pytest.raises(ValueError, match=r"problem: found a checkpoint of other images") as caught:
        wernet(*change(one), iterations=1, checkpoint=present, resume=True)
    assert str(present) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert present.read_bytes() == written


@pytest.mark.parametrize(
    "settings",
    [
        {"seed": 1},
        {"iterations": 2},
        {"settings": WernetSettings(channels=8)},
        {"settings": WernetSettings(penalty=1e-2)},
    ],
)
def test_a_checkpoint_of_other_settings_is_refused(scene, present, settings):
    one = scene(shading=SHADING)
    arguments = {"iterations": 1, "checkpoint": present, "resume": True, **settings}
    with pytest.raises(ValueError, match="problem: found a checkpoint of other"):
        wernet(one.projector, one.measured, **arguments)


def _truncated(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flipped(path):
    with zipfile.ZipFile(path) as archive:
        numbers = archive.read(max(archive.infolist(), key=lambda one: one.file_size))
    content = bytearray(path.read_bytes())
    content[content.find(numbers) + len(numbers) // 2] ^= 16
    path.write_bytes(content)


def _empty(path):
    path.write_bytes(b"")


def _text(path):
    path.write_text("no checkpoint")


def _an_encoder(path):
    save_encoder(CorrectionEncoder(), path)


def _a_list(path):
    torch.save([1, 2], path)


def _an_older_version(path):
    torch.save(torch.load(path, weights_only=True) | {"version": 7}, path)


def _damaged_state(path):
    content = torch.load(path, weights_only=True)
    del content["state"]["training"]["encoder"]["last.bias"]
    torch.save(content, path)


def _a_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    "damage",
    [
        _truncated, _flipped, _empty, _text, _an_encoder, _a_list, _an_older_version,
        _damaged_state, _a_folder,
    ],
)  # fmt: skip
def test_a_file_that_is_no_checkpoint_is_refused(scene, present, damage):
    one = scene(shading=SHADING)
    damage(present)
    with pytest.raises(ValueError, match=r"checkpoint\.pt: .*found .*expected") as caught:
        wernet(one.projector, one.measured, iterations=1, checkpoint=present, resume=True)
    assert "\n" not in str(caught.value)
    assert [path.name for path in present.parent.iterdir()] == [present.name]


def test_an_encoder_frozen_leaves_no_checkpoint(scene, checkpoint):
    one = scene(shading=SHADING)
    wernet(
        one.projector,
        one.measured,
        encoder=CorrectionEncoder(),
        freeze_encoder=True,
        checkpoint=checkpoint,
    )
    assert not checkpoint.exists()
