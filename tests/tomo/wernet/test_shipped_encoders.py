"""The encoders that come with the package: whole, small, local, and of no harm."""

import sys

import numpy as np
import pytest
import torch

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.metrics import cosine_distance
from tomo.simulation import simulate
from tomo.wernet import load_encoder, shipped_encoders
from tomo.wernet.default import CorrectionEncoder, RayWeights, ViewTokens, wernet
from tomo.wernet.encoder_file import SHIPPED

NAME = "finite-pixels"
GRID = VoxelGrid((12, 20, 9), (0.8, 1.0, 1.25))


@pytest.fixture(scope="module")
def scene():
    """Return projector, images and truth of pixels as large as voxels."""
    rig = rigs.ring(
        9, distance=90.0, image_size=(24, 34), footprint=1.0, pitch_degrees=[15.0, -20.0, 5.0] * 3
    )
    field = phantoms.create("jet", 4, GRID.extent, GRID.center)
    scan = simulate(rig, field, GRID, supersample=4, refine=2)
    system = LinearSystem.from_rig(rig, GRID, midpoints=True)
    return system.projector, system.flatten(list(scan.images.values())), scan.truth


def test_it_comes_with_the_package():
    assert NAME in shipped_encoders()
    path = SHIPPED / f"{NAME}.pt"
    assert path.stat().st_size < 20_000
    content = torch.load(path, weights_only=True)
    assert content["kind"] == "correction"
    encoder = load_encoder(NAME, CorrectionEncoder)
    assert all(torch.isfinite(value).all() for value in encoder.state_dict().values())
    assert any(value.any() for value in encoder.last.parameters())


def test_it_corrects_little_and_by_the_voxel_alone(scene):
    projector, _, truth = scene
    encoder = load_encoder(NAME)

    def ratio(volume, tells_views):
        tokens = ViewTokens(projector.n_views, encoder.channels)
        weights = RayWeights(encoder, tokens, volume, 1.0, tells_views)
        learned = weights.projector(projector).segments.length
        return learned / projector.segments.length

    volume = projector.active.compress(truth)
    found = ratio(volume, True)
    long = projector.segments.length > 0.2
    assert np.abs(found[long] - 1).max() < 0.5
    assert 1e-3 < found[long].std() < 0.1
    np.testing.assert_array_equal(ratio(7 * volume, False), found)


def test_frozen_it_transfers_without_harm(scene):
    projector, measured, truth = scene
    chords = wernet(projector, measured, iterations=0)
    found = wernet(projector, measured, encoder=NAME, freeze_encoder=True)
    assert found.settings["freeze_encoder"] is True
    residual = found.settings["held_out_residual"]
    assert residual["learned"] != residual["chords"]
    assert residual["learned"] < 1.1 * residual["chords"]
    assert cosine_distance(found.volume, truth) < 1.02 * cosine_distance(chords.volume, truth)


def test_frozen_it_is_judged_and_solved_as_the_chords_were(scene, monkeypatch):
    """Choosing anew took longer than all else."""
    from tomo.selection import choose
    from tomo.wernet.default import outer_iterations

    projector, measured, _ = scene
    made = []

    def noted(*arguments, **how):
        made.append(choose.choose_by_held_out_views(*arguments, **how))
        return made[-1]

    for module in (sys.modules["tomo.wernet.default.wernet"], outer_iterations):
        monkeypatch.setattr(module, "choose_by_held_out_views", noted)
    found = wernet(projector, measured, encoder=NAME, freeze_encoder=True)
    assert len(made) == 1
    assert found.settings["held_out_residual"]["chords"] == made[0].held_out_residual
    assert found.settings["solved_by"]["iterations"] == made[0].iterations
