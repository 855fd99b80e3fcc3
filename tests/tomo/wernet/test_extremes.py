"""Both forms of WERNet at unusual learning rates, batches, encoders and images.

The default may not be worse than the classic solve; the paper's ends with a finite volume and a
reason, or an error that it diverged.
"""

import math
from contextlib import contextmanager
from dataclasses import fields
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
import torch

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.metrics import cosine_similarity
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects
from tomo.wernet import PaperSettings, WernetSettings
from tomo.wernet.default import training, wernet
from tomo.wernet.paper import TrainingDivergedError, WeightEncoder, wernet_paper

GAIN_SPREAD = 0.1
NO_WORSE = 1 + 1e-6  # factor by which the same volume may seem worse than itself
EPOCHS = 3


def scene(edge=0.5, empty_rays=False):
    """Return images of a few blobs, by cameras of unknown gains.

    ``edge`` is a voxel's in the rig's unit; ``empty_rays`` keeps pixels that see no voxel.
    """
    grid = VoxelGrid((8, 10, 8), edge)
    rig = rigs.ring(
        14, distance=200.0 * edge, image_size=(24, 20), footprint=0.6 * edge, pitch_degrees=20
    )
    field = phantoms.create("blobs", 3, grid.extent, grid.center)
    scan = simulate_images(rig, field, grid, effects=Effects(gain_spread=GAIN_SPREAD), seed=3)
    system = LinearSystem.from_rig(rig, grid, midpoints=True, skip=not empty_rays)
    measured = system.flatten([scan.images[name] for name in rig.names])
    return SimpleNamespace(projector=system.projector, measured=measured, truth=scan.truth)


def error_of(volume, truth):
    """Return ``|f volume - truth| / |truth|`` with the best factor: the gains' is unknown."""
    return math.sqrt(1 - min(cosine_similarity(volume, truth), 1.0) ** 2)


@pytest.fixture(scope="module", autouse=True)
def one_thread(on_threads):
    with on_threads(1):
        yield


@pytest.fixture(scope="module")
def seen():
    return scene()


@pytest.fixture(scope="module")
def classic(seen):
    choice = choose_by_left_out_pixels(seen.projector, seen.measured)
    return solve_as_chosen(seen.projector, seen.measured, choice).volume


def assert_no_worse(found, seen, classic, truth=None):
    truth = seen.truth if truth is None else truth
    assert np.isfinite(found.volume).all()
    assert found.stop_reason
    assert error_of(found.volume, truth) < NO_WORSE * error_of(classic, truth)


def test_another_seed_is_no_worse_than_the_classic_solve_nor_changes_the_light(seen, classic):
    found = wernet(seen.projector, seen.measured, seed=1, iterations=2)
    assert_no_worse(found, seen, classic)
    assert abs(found.volume.sum() / classic.sum() - 1) < GAIN_SPREAD


@contextmanager
def counted_gradients():
    """Yield how many gradients there were, and how many of them were not finite."""
    counts = {"gradients": 0, "not finite": 0}
    plain = training.set_summed_gradients

    def counted(parameters, gradients):
        plain(parameters, gradients)
        counts["gradients"] += len(parameters)
        counts["not finite"] += sum(not p.grad.isfinite().all() for p in parameters)

    with patch.object(training, "set_summed_gradients", counted):
        yield counts


@pytest.mark.parametrize(
    "how",
    [{"learning_rate": 3e-5}, {"learning_rate": 0.3}, {"rays_per_step": 10},
     {"rays_per_step": 1 << 20}],
    ids=str,
)  # fmt: skip
def test_no_rate_or_batch_is_worse_than_the_classic_solve(seen, classic, how):
    with counted_gradients() as counts:
        found = wernet(seen.projector, seen.measured, iterations=2, settings=WernetSettings(**how))
    assert_no_worse(found, seen, classic)
    assert counts["gradients"] > 0 == counts["not finite"]


def test_the_rate_of_learning_is_what_is_asked_for(seen):
    residuals = []
    for rate in (3e-3, 0.3):
        settings = WernetSettings(learning_rate=rate)
        found = wernet(seen.projector, seen.measured, iterations=1, settings=settings)
        residuals.append(found.history[1].relative_residual)
    assert residuals[0] != residuals[1]


@pytest.mark.parametrize("light", [0.0, 0.1])
def test_rays_that_cross_no_voxel_do_no_harm(seen, classic, light):
    kept = scene(empty_rays=True)
    empty = kept.projector.row_sums == 0
    assert empty.any()
    measured = np.where(empty, light * kept.measured.max(), kept.measured).astype(np.float32)
    found = wernet(kept.projector, measured, iterations=2)
    assert_no_worse(found, seen, classic)


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_other_intensities_are_no_worse(seen, classic, factor):
    brighter = (seen.measured.astype(np.float64) * factor).astype(np.float32)
    found = wernet(seen.projector, brighter, iterations=2)
    assert_no_worse(found, seen, classic)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_other_units_of_length_are_no_worse(seen, classic, factor):
    longer = scene(edge=0.5 * factor)
    found = wernet(longer.projector, longer.measured, iterations=2)
    assert_no_worse(found, seen, classic, longer.truth)


def filled(value):
    encoder = WeightEncoder()
    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.fill_(value)
    return encoder


PAPER = {
    "slow": {"voxel_learning_rate": 1e-4, "encoder_learning_rate": 5e-6},
    "fast": {"voxel_learning_rate": 1.0, "encoder_learning_rate": 0.05},
    "one batch": {"rays_per_step": 1 << 20, "iterations": 1},
    "small batches": {"rays_per_step": 100, "iterations": 1},
    "weights of 30": {"encoder": 30.0},
    "weights of 1e10": {"encoder": 1e10},
    "weights of 1e30": {"encoder": 1e30},
    "weights of NaN": {"encoder": np.nan},
    "black": {"brightness": 0.0},
    "as bright as 1e30": {"brightness": 1e30},
    "as faint as 1e-30": {"brightness": 1e-30},
    "empty rays": {"empty_rays": True},
    "another seed": {"seed": 5},
}


@pytest.mark.parametrize("case", PAPER)
def test_the_paper_s_form_ends_with_a_finite_volume_or_says_that_it_diverged(seen, case):
    options = {"iterations": EPOCHS, **PAPER[case]}
    used = scene(empty_rays=True) if options.pop("empty_rays", False) else seen
    brightness = options.pop("brightness", 1.0)
    measured = (used.measured.astype(np.float64) * brightness).astype(np.float32)
    if "encoder" in options:
        options["encoder"] = filled(options["encoder"])
    names = options.keys() & {field.name for field in fields(PaperSettings)}
    settings = PaperSettings(**{name: options.pop(name) for name in names})
    try:
        found = wernet_paper(used.projector, measured, settings=settings, **options)
    except (ValueError, TrainingDivergedError) as error:
        said = str(error)
    else:
        said = found.stop_reason
        assert np.isfinite(found.volume).all()
    assert said
