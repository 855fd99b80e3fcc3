"""The voxel basis or the linear basis: which is taken, and how the volume fares."""

import json

import numpy as np
import pytest
import torch

import rigs
from phantoms import create
from tomo import VoxelGrid, load_scan
from tomo.io import read_volume
from tomo.metrics import cosine_distance
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects
from tomo.wernet import Encoder, save_encoder

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((14, 32, 14), 1.0)
SMALL = VoxelGrid((10, 22, 10), 1.0)
TINY = VoxelGrid((6, 10, 6), 1.0)
# what is wrong with images says nothing of the basis; gains are what weights may learn
QUICK = {"screen": False, "refine_cameras": "none", "fit_absorption": False, "uncertainty": 0}


@pytest.fixture(scope="session")
def take(tmp_path_factory):
    """Return a function that takes images of a flame and returns the scan."""

    def scan(views=11, footprint=0.5, *, grid=SMALL, refine=4, **how):
        folder = tmp_path_factory.mktemp("taken") / "scan"
        size = (int(1.6 * grid.extent[0] / footprint), int(1.23 * grid.extent[1] / footprint))
        rig = rigs.ring(
            views,
            distance=400.0,
            image_size=size,
            footprint=footprint,
            pitch_degrees=np.resize([12.0, -12.0], views),
            start_degrees=5.0,
        )
        field = create("turbulent", 4, grid.extent, grid.center)
        simulate_images(rig, field, grid, supersample=2, refine=refine, **how).save(folder)
        return load_scan(folder)

    return scan


@pytest.fixture(scope="session")
def fine(take):
    return take(grid=GRID)


@pytest.fixture(scope="session")
def small(take):
    return take()


@pytest.fixture(scope="session")
def few(take):
    return take(views=6)


@pytest.fixture(scope="session")
def classic(small):
    return reconstruct(small, options=Options(**QUICK))


def basis(outcome):
    return outcome.report()["basis"]["name"]


def distance(outcome):
    return outcome.solution.quality["cosine_distance"]


SEEN = {"hold_out": ["cam03"], "compare": ["art:3", "sirt:20"], **QUICK}


@pytest.fixture(scope="session")
def by_linear(fine):
    return reconstruct(fine, options=Options(**SEEN))


@pytest.fixture(scope="session")
def by_voxel(fine):
    return reconstruct(fine, options=Options(basis="voxel", **SEEN))


def residual_of_used(outcome):
    used = [view for view in outcome.views if not view.held_out]
    squared = sum(np.square(view.measured - view.reprojected)[view.mask].sum() for view in used)
    return np.sqrt(squared / sum(np.square(view.measured)[view.mask].sum() for view in used))


def psnr(outcome, name):
    return outcome.report()["held_out"][name]["psnr"]


def test_a_flame_in_fine_pixels_is_nearer_to_the_truth_in_the_linear_basis(by_linear, by_voxel):
    assert (basis(by_linear), basis(by_voxel)) == ("linear", "voxel")
    assert distance(by_linear) < 0.8 * distance(by_voxel)
    assert psnr(by_linear, "cam03") > psnr(by_voxel, "cam03") + 1
    json.dumps(by_linear.report(), allow_nan=False)


def test_the_volume_holds_means_and_the_distances_are_theirs(by_linear, fine):
    truth, *_ = read_volume(fine.truth)
    found = by_linear.solution
    assert cosine_distance(found.volume, truth) == pytest.approx(distance(by_linear), rel=1e-6)
    assert by_linear.solution.history[-1].distance == pytest.approx(distance(by_linear), rel=1e-5)
    assert found.volume.sum() == pytest.approx(truth.sum(), rel=0.02)
    assert found.volume.min() >= 0


def test_re_projected_images_are_those_that_were_solved_for(by_linear):
    residual = by_linear.solution.relative_residual
    assert residual_of_used(by_linear) == pytest.approx(residual, rel=0.05)


def test_ray_by_ray_methods_are_compared_in_the_voxel_basis(by_linear, by_voxel):
    art, sirt = (
        [one.comparisons[number].volume for one in (by_linear, by_voxel)] for number in (0, 1)
    )
    np.testing.assert_array_equal(*art)
    assert (sirt[0] != sirt[1]).any()


def test_pixels_too_fine_for_their_worth_take_the_voxel_basis(take):
    scan = take(views=3, footprint=0.08, grid=TINY, refine=1)
    found = reconstruct(scan, options=Options(method="cgls", iterations=2, **QUICK))
    assert "times the work" in found.basis["reason"]


def test_on_the_fly_takes_the_voxel_basis_and_the_linear_one_when_asked(few):
    settings = {"method": "sirt", "iterations": 3, "projector": "on-the-fly", **QUICK}
    assert basis(reconstruct(few, options=Options(**settings))) == "voxel"
    found = [
        reconstruct(
            few, options=Options(**{**settings, "projector": form}, basis="linear")
        ).solution.volume
        for form in ("stored", "on-the-fly")
    ]
    assert cosine_distance(*found) < 1e-4


def test_many_views_that_teach_nothing_end_in_the_linear_basis(small, classic):
    found = reconstruct(small, options=Options(method="wernet", **QUICK))
    assert basis(found) == "linear"
    assert found.solution.settings["method"] == "wernet"
    assert found.solution.settings["learned"] is False
    np.testing.assert_array_equal(found.solution.volume, classic.solution.volume)


def test_weights_are_learned_in_the_linear_basis(take):
    scan = take(grid=GRID, effects=Effects(gain_spread=0.1), seed=3)
    given = {"hold_out": ["cam03"], **QUICK}
    settings = {"method": "wernet", "compare": ["sirt:20"], **given}
    found, boxes = (
        reconstruct(scan, options=Options(basis=one, **settings)) for one in ("auto", "voxel")
    )
    learned, of_voxels = (one.solution for one in (found, boxes))
    assert basis(found) == "linear"
    assert learned.settings["learned"] is of_voxels.settings["learned"] is True
    assert distance(found) < 0.85 * distance(boxes)
    assert psnr(found, "cam03") > psnr(boxes, "cam03")
    assert found.solution.history[-1].distance == pytest.approx(distance(found), rel=1e-5)
    assert residual_of_used(found) == pytest.approx(learned.relative_residual, rel=0.05)
    # what is compared with knows the chords alone
    classic = reconstruct(scan, options=Options(method="sirt", iterations=20, **given))
    np.testing.assert_array_equal(found.comparisons[0].volume, classic.solution.volume)


def test_the_report_says_what_was_tried_and_what_was_taken(by_linear):
    found = by_linear.report()["solver"]
    tried = {(width, strength): rest for width, strength, *rest in found["tried"]}
    assert len(tried) == len(found["tried"]) > 3
    iterations, residual = tried[found["smooth_width"], found["strength"]]
    assert iterations >= by_linear.solution.history[-1].index
    assert residual == min(residual for _, residual in tried.values())
    assert f"{residual:.4f}" in by_linear.solution.stop_reason


def test_given_weights_are_tried_in_the_linear_basis(small, classic, tmp_path):
    encoder, path = Encoder(silent=True, seed=2), tmp_path / "encoder.pt"
    torch.nn.init.normal_(
        encoder.last.weight, 0.0, 0.01, generator=torch.Generator().manual_seed(2)
    )
    save_encoder(encoder, path)
    how = tmp_path / "how.yaml"
    how.write_text("encoder: encoder.pt\nfreeze_encoder: true\n")
    frozen = reconstruct(small, method="wernet", wernet_settings=how, **QUICK)
    assert basis(frozen) == "linear"
    assert np.isfinite(frozen.solution.settings["held_out_residual"]["learned"])
    np.testing.assert_array_equal(frozen.solution.volume, classic.solution.volume)


def test_few_views_end_in_the_linear_basis(few):
    found, boxes = (
        reconstruct(few, options=Options(method="wernet", basis=one, **QUICK))
        for one in ("auto", "voxel")
    )
    assert basis(found) == "linear"
    assert distance(found) < distance(boxes)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"basis": "blobs"}, "basis: found 'blobs', expected one of auto, voxel, linear"),
        ({"basis": "linear", "method": "art"}, "basis: found linear, expected voxel: method art"),
        ({"basis": "linear", "blur": 1.0}, "basis: found linear, expected voxel: blur 1.0 is"),
    ],
)
def test_impossible_options_are_refused(fine, settings, words):
    with pytest.raises(ValueError, match=words):
        reconstruct(fine, options=Options(**settings))
