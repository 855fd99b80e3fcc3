"""Known scenes: the forward model against closed forms, and what makes scenes and faults fair."""

import math

import numpy as np
import pytest
from studies.scenes import cameras, scene
from studies.scenes.exposure import NOISES, PEDESTAL, TWELVE_BIT, Exposure, recorded, stored
from studies.scenes.faults import FAULTS, Setting
from studies.scenes.fields import CUT, FAMILIES, KnownField, LaterField
from studies.scenes.findings import EFFECTS
from studies.scenes.forward import radiance
from studies.scenes.media import Gas, cloud, displacements, hot_core, sheath
from studies.scenes.recipe import HALVES, Recipe

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
    seen = radiance(camera, Blob(), Gas(q), supersample=1)
    expected = -np.expm1(-q * integrals) / q
    assert np.abs(seen - expected).max() < 1e-4 * expected.max()


def test_a_medium_dims_by_the_length_in_front():
    a = 0.1
    ahead = Camera("ahead", (3, 3), [[2000, 0, 1], [0, 2000, 1], [0, 0, 1]], t=[0, 0, 100])
    ahead = ahead.transformed(np.eye(3), GRID.center)
    half = GRID.extent[2] / 2
    clear, dimmed = (radiance(ahead, Blob(), Gas(0, k), supersample=1)[1, 1] for k in (0, a))
    # the integral of exp(-z^2 / 2 w^2 - a (z + half)) over all z
    assert dimmed / clear == pytest.approx(math.exp(-a * half + 0.5 * (a * WIDTH) ** 2), rel=1e-4)


def test_a_uniform_absorber_is_a_medium(camera):
    def even(points):
        return 0.1 * (np.abs(points - GRID.center) <= GRID.extent / 2).all(axis=-1)

    medium = radiance(camera, Blob(), Gas(absorption=0.1), supersample=1)
    seen = radiance(camera, Blob(), Gas(absorber=even), supersample=1)
    assert np.abs(seen - medium).max() < 3e-3 * medium.max()


@pytest.mark.parametrize("made", [cloud(GRID, 0.7, 0.0), sheath(GRID, 0.7)])
def test_absorbers_have_their_depth(made):
    x = np.linspace(0, GRID.extent[0], 4001)  # outwards from the axis, past cloud and wall
    points = np.stack([x, 0 * x, 0 * x], axis=-1) + GRID.center
    assert np.trapezoid(made(points), x) == pytest.approx(0.7, rel=2e-3)
    assert made(np.asarray(GRID.center)) < 0.02


def test_rays_are_bent_by_the_gradient_of_the_index():
    """In an even gradient rays are parabolas; a hot core displaces the one that it bends most."""
    along = np.linspace(0, 24, 97)[:-1] + 0.125
    across = np.stack([np.linspace(-12, 12, 41), np.zeros(41), np.full(41, -12.0)], axis=1)
    points = across[:, None] + along[:, None] * np.array([0, 0, 1.0]) + GRID.center
    ahead, length = np.tile([0, 0, 1.0], (41, 1)), np.full(41, 0.25)
    off = displacements(lambda p: np.full_like(p, [0.01, 0, 3.0]), points, ahead, length)
    np.testing.assert_allclose(off[0, :, 0], 0.005 * along**2, atol=2e-3)
    assert not off[..., 1:].any()
    off = displacements(hot_core(GRID, 0.7), points, ahead, length)
    assert np.abs(off).max() == pytest.approx(0.7, rel=0.1)
    assert off[-1, -1, 0] > 0 > off[0, -1, 0]  # away from the hot middle


def test_bent_rays_see_light_elsewhere(camera):
    straight, bent = (
        radiance(camera, Blob(), Gas(bending=hot_core(GRID, size)), supersample=1)
        for size in (0, 0.7)
    )
    assert np.array_equal(straight, radiance(camera, Blob(), supersample=1))
    assert 0.005 < np.abs(bent - straight).max() / straight.max() < 0.2


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
    own = field.family, field.seed, GRID
    still, near, far = (phantoms.sample(LaterField(*own, d), GRID, 1) for d in (0, 0.5, 2.0))
    assert metrics.nrmse(near, still) < metrics.nrmse(far, still)


def test_halves_have_no_family_in_common_and_name_all():
    settle, report, fresh = HALVES.values()
    assert not set(settle) & set(report)
    assert fresh == report
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
        expected = {"unlike": (1, 2, 3), "narrow": (3,)}.get(kind, (0,))
        assert cut in expected
    with pytest.raises(ValueError, match="rig: found 'cube-6'"):
        cameras.rig("cube-6", GRID, 1)


@pytest.fixture
def small(monkeypatch):
    """Scenes are seen with one ray a pixel and a step a voxel, and their truth is rough."""
    rough = {"supersample": 1, "step": 1.0}
    monkeypatch.setattr(Exposure, "light", lambda self: radiance(*self.sight, **rough))
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
    assert set().union(*fault.names) <= set(EFFECTS)
    sizes = [
        Recipe("settle", "vortex rings", "two-level-6", "12 bit", 1, name, size)
        for size in range(3)
    ]
    plain, changes = scene.known_scene(sizes[0].faultless, cache), []
    for recipe in sizes:
        faulty = scene.known_scene(recipe, cache)
        away = [
            np.abs(faulty.images[n].astype(float) - plain.images[n]).sum() for n in plain.rig.names
        ]
        changed = tuple(n for n, d in zip(plain.rig.names, away, strict=True) if d)
        if fault.single:
            assert changed == faulty.at_fault
            assert len(changed) == (2 if name in TWO else 1)
            assert plain.rig.names[recipe.view] in changed
            assert {camera for _, camera in faulty.expected} == set(changed)
        else:
            assert faulty.at_fault == ()
            assert len(changed) > 1
            assert faulty.expected == ((fault.names[0], None),)
        assert faulty.mendable == (recipe.size < fault.mendable)
        changes.append(sum(away))
    if name not in UNORDERED:
        assert changes == sorted(changes)


TWO = ("swapped", "frame before two", "two at once")
UNORDERED = ("gain", "swapped", "mirrored", "cap", "one file twice")
"""Faults whose sizes do not grow one way."""


def faulty_exposures(name, size, view=1):
    """Return the exposures of a ring of six with and without a fault, of a Gaussian."""
    rig = cameras.rig("ring-6", GRID, 3)
    plain = tuple(Exposure(camera, Blob()) for camera in rig)
    return plain, FAULTS[name].make(plain, Setting(view, size, 1.0, np.random.default_rng(0)))


@pytest.mark.parametrize("name", ["magnified", "all magnified"])
@pytest.mark.parametrize("size", [0.01, -0.12])
def test_a_magnified_camera_moves_marks_by_the_fraction(name, size):
    plain, wrong = faulty_exposures(name, size)
    marks = np.asarray(GRID.center) + np.array([[3.0, 5, 0], [0, -9, 4]])
    for number, (before, after) in enumerate(zip(plain, wrong, strict=True)):
        middle = before.camera.camera_matrix[:2, 2]
        near, far = (one.camera.project(marks)[0] - middle for one in (before, after))
        changed = number == 1 or name == "all magnified"
        np.testing.assert_allclose(far, (1 + size * changed) * near, rtol=1e-9)


IMAGE = np.zeros((20, 40))
IMAGE[4:14, 5:25] = 0.5


def imaged(**changes):
    """Return what a camera makes of an image of a bright rectangle."""
    return Exposure(None, None, **changes).image(IMAGE)


def test_a_frame_hides_its_part_of_the_flame_on_all_sides():
    rows, columns = np.nonzero(imaged(framed=0.4))
    assert (rows.min(), rows.max()) == (6, 11)
    assert (columns.min(), columns.max()) == (9, 20)


def test_a_ghost_is_mirrored_and_beside_itself():
    added = imaged(ghost=0.05) - IMAGE
    rows, columns = np.nonzero(added)
    assert (rows.min(), rows.max()) == (4, 13)
    assert columns.min() == 40 - 25 + 6  # mirrored, and 15 % of the width further
    assert added.max() == pytest.approx(0.05 * 0.5)


def test_a_veil_is_wide_and_motion_keeps_light():
    veil = imaged(veil=0.3) - IMAGE
    assert 0.5 * 0.3 * IMAGE.sum() < veil.sum() <= 0.3 * IMAGE.sum()
    assert veil[:, 39].max() > 0.02 * veil.max()
    smeared = imaged(motion=5)
    assert smeared.sum() == pytest.approx(IMAGE.sum())
    assert np.flatnonzero(smeared[9] > 1e-9)[[0, -1]] == pytest.approx([3, 26])


def test_backgrounds_run_across_and_columns_are_hot():
    slope = imaged(gradient=0.1) - IMAGE
    np.testing.assert_allclose(slope[3], np.linspace(0, 0.1, 40), atol=1e-12)
    hot = imaged(hot=(7, 0.2)) - IMAGE
    assert np.flatnonzero(hot.any(axis=0)) == [7]


def test_a_cap_leaves_noise_alone_or_one_value():
    _, wrong = faulty_exposures("cap", 1)
    dark = wrong[1].image(IMAGE)
    assert not dark.any()
    noise = recorded(dark, TWELVE_BIT, (0, 1)).astype(float)
    assert noise.mean() == pytest.approx(4095 * PEDESTAL, abs=0.5)
    assert 3 < noise.std() < 8  # the read-out's 8 of 5000 electrons, in counts
    for size, value in ((2, 0), (3, 100)):
        (one,) = (e for e in faulty_exposures("cap", size)[1] if e.dead)
        assert (
            stored(recorded(dark, TWELVE_BIT, (0, 1)), TWELVE_BIT, 1.0, one.dead) == value
        ).all()


def test_gamma_is_a_curve_in_eight_bits():
    counts = np.arange(4096, dtype=np.uint16)
    kept = stored(counts, TWELVE_BIT, 2.0, "")
    assert kept.dtype == counts.dtype
    assert len(np.unique(kept)) <= 256
    light = np.clip((counts - 100.0) / 4095, 0, 1)
    expected = np.minimum(4095 * np.sqrt(light) + 100, 4095)
    assert np.abs(kept - expected).max() <= 0.5 * 4095 / 255 + 0.5
    assert stored(counts, TWELVE_BIT, 1.0, "") is counts


@pytest.mark.usefixtures("small")
def test_one_file_of_two_cameras_is_the_same_to_the_bit():
    found = scene.known_scene(
        Recipe("settle", "sparks", "ring-6", "12 bit", 1, "one file twice", 1)
    )
    same = [
        n
        for n in found.rig.names
        if np.array_equal(found.images[n], found.images[found.at_fault[0]])
    ]
    assert len(same) == 2  # fmt: skip


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("half", ["settle", "report"])
def test_half_of_the_narrow_views_cut_the_flame(half):
    family = next(one for one in HALVES[half] if one.startswith("off-axis"))
    seed = {"settle": 50, "report": 1050}[half]
    found = scene.known_scene(Recipe(half, family, "narrow-6", "clean", seed))
    for number, name in enumerate(found.rig.names):
        image = found.images[name]
        rim = max(image[0].max(), image[-1].max(), image[:, 0].max(), image[:, -1].max())
        assert (rim > 0.1 * image.max()) == bool(number % 2)


def test_seeds_tell_the_fresh_half():
    recipe = Recipe("fresh", "hollow swirl", "ring-7", "12 bit", 5000, "gain", 1)
    assert recipe.name == "fresh hollow swirl, ring-7, 12 bit, seed 5000, gain 2"
    assert recipe.faultless.half == "fresh"
    for half, seed in (("fresh", 4999), ("report", 5000)):
        with pytest.raises(ValueError, match=f"seed: found {seed} of half {half}"):
            Recipe(half, "hollow swirl", "ring-7", "12 bit", seed)
