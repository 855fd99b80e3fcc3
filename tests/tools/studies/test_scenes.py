"""Known scenes: the forward model against closed forms, and what makes scenes and faults fair."""

import math

import numpy as np
import pytest
from studies.scenes import cameras, scene
from studies.scenes.exposure import Exposure
from studies.scenes.faults import FAULTS
from studies.scenes.fields import CUT, FAMILIES, KnownField, LaterField
from studies.scenes.forward import radiance
from studies.scenes.recipe import HALVES, Recipe
from studies.scenes.recording import NOISES

import phantoms
from rigs import Camera
from tomo import VoxelGrid, metrics

GRID = VoxelGrid((24, 32, 24), 1.0, (1.3, -0.7, 0.4))
WIDTH = 1.7


class Blob:
    """A Gaussian in the middle of the grid."""

    grid = GRID
    reach = (GRID.lower, GRID.upper)

    def __call__(self, points):
        square = np.square(np.asarray(points) - GRID.center).sum(axis=-1)
        return np.exp(-0.5 * square / WIDTH**2)


@pytest.fixture(scope="module")
def camera():
    return cameras.rig("unlike-5", GRID, 3)[1].scaled(0.4)


@pytest.fixture(scope="module")
def integrals(camera):
    """Return the line integrals of the blob through the pixels' centres, in closed form."""
    origins, directions = camera.rays()
    away = np.asarray(GRID.center) - origins
    along = (away * directions).sum(axis=1)
    square = np.square(away).sum(axis=1) - along**2
    values = WIDTH * math.sqrt(2 * math.pi) * np.exp(-0.5 * square / WIDTH**2)
    return values.reshape(camera.image_size[::-1])


def test_a_ray_sees_the_line_integral(camera, integrals):
    seen = radiance(camera, Blob(), supersample=1)
    assert np.abs(seen - integrals).max() < 1e-4 * integrals.max()


@pytest.mark.parametrize("depth", [0.2, 2.0])
def test_self_absorption_is_that_of_the_closed_form(camera, integrals, depth):
    q = depth / integrals.max()
    seen = radiance(camera, Blob(), supersample=1, self_absorption=q)
    expected = -np.expm1(-q * integrals) / q
    assert np.abs(seen - expected).max() < 1e-4 * expected.max()


def test_a_medium_dims_by_the_length_in_front():
    a = 0.1
    ahead = Camera("ahead", (3, 3), [[2000, 0, 1], [0, 2000, 1], [0, 0, 1]], t=[0, 0, 100])
    ahead = ahead.transformed(np.eye(3), GRID.center)
    half = GRID.extent[2] / 2
    clear, dimmed = (radiance(ahead, Blob(), supersample=1, absorption=k)[1, 1] for k in (0, a))
    # the integral of exp(-z^2 / 2 w^2 - a (z + half)) over all z
    assert dimmed / clear == pytest.approx(math.exp(-a * half + 0.5 * (a * WIDTH) ** 2), rel=1e-4)


def test_pixels_are_means_over_their_area(camera):
    fine, coarse = radiance(camera, Blob(), supersample=4), radiance(camera, Blob())
    middle = radiance(camera, Blob(), supersample=1)
    far, near = (np.abs(one - fine).max() for one in (middle, coarse))
    assert near < 0.3 * far


@pytest.mark.parametrize("family", FAMILIES)
def test_fields_are_sized_for_their_grid(family):
    field = KnownField(family, 1, GRID)
    volume = phantoms.sample(field, GRID, 2)
    assert np.array_equal(volume, phantoms.sample(KnownField(family, 1, GRID), GRID, 2))
    other = phantoms.sample(KnownField(family, 2, GRID), GRID, 2)
    assert metrics.cosine_distance(volume, other) > 1e-3
    assert volume.min() >= 0
    around = VoxelGrid((30, 60, 30), 1.0, GRID.center)
    outside = phantoms.sample(field, around, 1)
    lower, upper = field.reach
    inside = ((around.centers() > lower) & (around.centers() < upper)).all(axis=-1)
    assert outside[~inside].max() < 0.05 * volume.max()
    assert (outside[:, 46:54].max() > 0.01 * volume.max()) == (family in CUT)


def test_gas_moves_by_the_distance():
    field = KnownField("tilted cone", 1, GRID)
    still, near, far = (phantoms.sample(LaterField(field, d), GRID, 1) for d in (0, 0.5, 2.0))
    assert metrics.nrmse(near, still) < metrics.nrmse(far, still)


def test_halves_have_no_family_in_common_and_name_all():
    settle, report = HALVES.values()
    assert not set(settle) & set(report)
    assert {*settle, *report} == set(FAMILIES)
    with pytest.raises(ValueError, match="family: found 'sparks', expected one of hollow swirl"):
        Recipe("report", "sparks", "ring-5", "clean", 0)


def test_every_kind_of_rig_sees_the_grid():
    for kind in cameras.KINDS:
        rig = cameras.rig(f"{kind}-6", GRID, 1)
        assert len(rig) == 6
        corners = np.stack(np.meshgrid(*zip(GRID.lower, GRID.upper, strict=True)), -1)
        inside = [camera.inside(camera.project(corners.reshape(-1, 3))[0]) for camera in rig]
        cut = sum(not seen.all() for seen in inside)
        assert cut == 0 if kind != "unlike" else 1 <= cut <= 3
    with pytest.raises(ValueError, match="rig: found 'cube-6'"):
        cameras.rig("cube-6", GRID, 1)


@pytest.fixture
def small(monkeypatch):
    """Scenes are seen with one ray a pixel and a step a voxel, and their truth is rough."""
    rough = {"supersample": 1, "step": 1.0}
    light = lambda self: radiance(  # noqa: E731
        self.camera,
        self.field,
        self_absorption=self.self_absorption,
        absorption=self.absorption,
        **rough,
    )
    monkeypatch.setattr(Exposure, "light", light)
    monkeypatch.setattr(scene, "TRUTH_POINTS", 1)


@pytest.mark.usefixtures("small")
def test_scenes_are_the_same_from_the_cache_and_anew(tmp_path):
    for noise in NOISES:
        recipe = Recipe("settle", "sparks", "unlike-5", noise, 2, "shift", 1)
        made, kept, anew = (scene.known_scene(recipe, c) for c in (tmp_path, tmp_path, None))
        assert made.wrong == kept.wrong == anew.wrong == made.at_fault
        assert np.array_equal(made.truth, anew.truth)
        for name, image in anew.images.items():
            assert np.array_equal(made.images[name], image)
            assert np.array_equal(kept.images[name], image)
        masks = kept.scan.masks()
        assert all(mask.all() for mask in masks)


@pytest.mark.usefixtures("small")
def test_images_in_twelve_bits_are_those_without_noise_and_noise(tmp_path):
    clean, noisy = (
        scene.known_scene(Recipe("settle", "smoke sheets", "ring-5", noise, 0), tmp_path)
        for noise in ("clean", "12 bit")
    )
    assert np.array_equal(clean.truth, noisy.truth)
    differences = np.stack(noisy.scan.images()) - np.stack(clean.scan.images())
    assert abs(differences.mean()) < 2e-4
    assert 1e-3 < differences.std() < 1e-2


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_the_images_of_the_cameras_it_names(name, tmp_path_factory):
    cache, fault = tmp_path_factory.getbasetemp() / "scenes", FAULTS[name]
    for half, family in (("settle", "vortex rings"), ("report", "hollow swirl")):
        recipe = Recipe(half, family, "two-level-6", "12 bit", 1, name)
        plain = scene.known_scene(recipe.faultless, cache)
        changes = []
        for size in range(3):
            faulty = scene.known_scene(
                Recipe(half, family, "two-level-6", "12 bit", 1, name, size), cache
            )
            away = [
                np.abs(faulty.images[n].astype(float) - plain.images[n]).sum()
                for n in plain.rig.names
            ]
            changed = tuple(n for n, d in zip(plain.rig.names, away, strict=True) if d)
            if fault.single:
                assert changed == faulty.at_fault
                assert len(changed) == (2 if name == "swapped" else 1)
            else:
                assert faulty.at_fault == ()
                assert len(changed) > 1
            changes.append(sum(away))
        if name not in ("gain", "swapped", "mirrored"):  # sizes that do not grow one way
            assert changes == sorted(changes)
