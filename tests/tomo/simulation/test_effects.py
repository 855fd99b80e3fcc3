from dataclasses import replace

import numpy as np
import pytest

from phantoms import GaussianBlobs, SampledField, sample
from rigs import Camera, Optics, Rig
from rigs.camera import look_at
from tomo import LinearSystem, Projector, Rays, VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.operators.absorption import transmission
from tomo.rays.ray_box import enter_box
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects
from tomo.trace import trace

GRID = VoxelGrid((6, 8, 6), 1.0, (0.5, -1.0, 2.0))
BLOBS = GaussianBlobs([[0.9, -1.4, 2.2], [0.1, 0.3, 1.6]], [0.7, 0.6], [1.0, 2.0])
EVEN = SampledField(np.full(GRID.shape, 0.8), GRID)


def camera(name, position, focal=900.0, size=(30, 40), optics=None):
    R, t = look_at(position, GRID.center)
    middle = [(side - 1) / 2 for side in size]
    K = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    return Camera(name, size, K, R=R, t=t, optics=optics)


RIG = Rig((camera("side", (310.0, 43.0, 17.0)), camera("slant", (-120.0, 150.0, 250.0))))
EVERYTHING = Effects(
    gain_spread=0.1, absorption=0.1, self_absorption=0.2, vignetting=0.3, aperture=9.0,
    focus_distance=290.0,
)  # fmt: skip


def lengths(one):
    width, height = one.image_size
    return enter_box(Rays.from_camera(one), GRID).length.reshape(height, width)


@pytest.mark.parametrize(("k", "q"), [(0.3, 0.0), (0.0, 0.5), (0.2, 0.25)])
def test_absorption_in_even_gas_has_its_closed_form(k, q):
    """``∫ E exp(-(k + q E) s) ds``, which finer voxels approach at second order."""
    effects = Effects(absorption=k, self_absorption=q)
    emission, decay = 0.8, k + 0.8 * q
    errors = []
    for refine in (1, 2, 4):
        scan = simulate_images(RIG, EVEN, GRID, refine=refine, effects=effects)
        differences = [
            scan.images[one.name] - emission * -np.expm1(-decay * lengths(one)) / decay
            for one in RIG
        ]
        errors.append(max(np.abs(difference).max() for difference in differences))
    assert errors[-1] < 1e-3
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (orders > 1.9).all(), (errors, orders)


def slow_transmission(segments, rays, grid, k, q, emission):
    """Walk every ray in Python: what light of a segment's middle has to pass."""
    through = []
    for ray in range(len(rays)):
        inside = slice(segments.ptr[ray], segments.ptr[ray + 1])
        length = segments.length[inside] / rays.weight[ray]
        depth = q * emission[segments.voxel[inside]] * length
        entry = rays.origins[ray] + rays.directions[ray] * entry_time(rays, grid, ray)
        way = np.linalg.norm(segments.midpoint[inside] + grid.center - entry, axis=1)
        through.append(np.exp(-k * way - np.cumsum(depth) + depth / 2))
    return np.concatenate(through)


def entry_time(rays, grid, ray):
    """Return when a ray enters the box, 0 when it starts inside."""
    origin, direction = rays.origins[ray], rays.directions[ray]
    times = np.stack([(grid.lower - origin) / direction, (grid.upper - origin) / direction])
    return max(times.min(axis=0).max(), 0.0)


@pytest.mark.parametrize("position", [(310.0, 43.0, 17.0), (0.9, -0.7, 1.8)])
def test_transmission_agrees_with_a_slow_walk(position):
    one = camera("any", position, focal=20.0 if position[0] < 9 else 900.0)
    rays = Rays.from_camera(one, supersample=2)
    rays = replace(rays, pixel_ptr=np.arange(len(rays) + 1))
    segments = trace(rays, GRID, midpoints=True, dtype=np.float64)
    assert len(segments) > 1000
    emission = np.random.default_rng(0).random(GRID.size)
    found = transmission(segments, rays, GRID, 0.1, 0.3, emission)
    expected = slow_transmission(segments, rays, GRID, 0.1, 0.3, emission)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert found.min() < 0.5
    assert found.max() > 0.9


def test_another_tracer_gives_the_same_images():
    scan = simulate_images(RIG, BLOBS, GRID, effects=EVERYTHING)
    other = simulate_images(RIG, BLOBS, GRID, effects=EVERYTHING, tracer="raycast")
    for name, image in scan.images.items():
        np.testing.assert_allclose(other.images[name], image, rtol=1e-4, atol=1e-5)


def test_no_effects_change_nothing():
    plain = simulate_images(RIG, BLOBS, GRID, supersample=2, noise=0.1, seed=3)
    scan = simulate_images(RIG, BLOBS, GRID, supersample=2, noise=0.1, seed=3, effects=Effects())
    for name, image in plain.images.items():
        np.testing.assert_array_equal(scan.images[name], image)
    assert scan.settings == plain.settings
    assert plain.settings["effects"] is None


def test_gains_have_mean_one_and_the_spread_asked_for():
    for spread in (0.1, 0.5):
        gains = Effects(gain_spread=spread).gains(20_000, seed=1)
        assert gains.mean() == pytest.approx(1, abs=1e-12)
        assert gains.std() == pytest.approx(spread, rel=0.05)
        assert gains.min() > 0
    effects = Effects(gain_spread=0.1)
    np.testing.assert_array_equal(effects.gains(5, seed=2), effects.gains(5, seed=2))
    assert (effects.gains(5, seed=2) != effects.gains(5, seed=3)).all()
    assert effects.gains(1, seed=2) == 1
    assert (Effects().gains(4) == 1).all()


def test_vignetting_is_one_in_the_middle_and_follows_a_cosine():
    one = RIG[0]
    width, height = one.image_size
    effects = Effects(vignetting=0.4)
    middle, corner = ((width - 1) / 2, (height - 1) / 2), (-0.5, -0.5)
    assert effects.falloff(one, [middle])[0] == 1
    assert effects.falloff(one, [corner])[0] == pytest.approx(0.6)
    along = np.linspace(middle, corner, 50)
    share = np.linspace(0, 1, 50)
    angle = np.arccos(0.6**0.25)  # of the corner, were it the lens's own falloff
    expected = np.cos(np.arctan(share * np.tan(angle))) ** 4
    np.testing.assert_allclose(effects.falloff(one, along), expected, rtol=1e-12)


def test_a_lens_without_width_is_a_pinhole():
    plain, closed, narrow = (
        simulate_images(RIG, BLOBS, GRID, effects=effects)
        for effects in (
            None,
            Effects(aperture=0.0, focus_distance=300.0),
            Effects(aperture=1e-4, focus_distance=200.0),
        )
    )
    for name, image in plain.images.items():
        np.testing.assert_array_equal(closed.images[name], image)
        np.testing.assert_allclose(narrow.images[name], image, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("supersample", [1, 3])
def test_rays_of_a_lens_meet_in_the_plane_in_focus(supersample):
    one = RIG[0]
    effects = Effects(aperture=20.0, focus_distance=250.0, aperture_rays=200)
    pixels = np.array([7, 600, 1100])
    lines = Rays.from_camera(one, pixels, supersample)
    rays = effects.rays(one, pixels, supersample)
    count = effects.rays_per_pixel(supersample)
    assert count >= 200
    assert len(rays) == 3 * count
    assert rays.n_pixels == 3
    np.testing.assert_allclose(np.add.reduceat(rays.weight, rays.pixel_ptr[:-1]), 1)

    axis = one.R[2]
    times = (250.0 - (rays.origins - one.position) @ axis) / (rays.directions @ axis)
    focus = rays.origins + rays.directions * times[:, None]
    expected = lines.origins + lines.directions * (250.0 / (lines.directions @ axis))[:, None]
    expected = np.repeat(expected, count // supersample**2, axis=0)
    np.testing.assert_allclose(focus, expected, atol=1e-9)

    lens = (rays.origins - one.position)[:count] @ one.R.T  # of the first pixel
    np.testing.assert_allclose(lens[:, 2], 0, atol=1e-10)
    assert np.hypot(lens[:, 0], lens[:, 1]).max() <= 10.0
    weights = rays.weight[:count]
    np.testing.assert_allclose(weights @ lens, 0, atol=1e-9)
    np.testing.assert_allclose(weights @ np.square(lens[:, :2]), 10.0**2 / 4, rtol=1e-9)


def spot(effects):
    """Return the image of a small spot in the middle of the box, 300 from the camera."""
    one = camera("front", np.add(GRID.center, (0, 0, 300.0)), focal=3000.0, size=(41, 41))
    grid = VoxelGrid((41, 41, 5), 0.1, GRID.center)
    field = GaussianBlobs([GRID.center], [0.12], [1.0])
    return simulate_images(Rig((one,)), field, grid, refine=1, effects=effects).images["front"]


def test_a_spot_is_sharp_in_focus_and_a_disc_out_of_it():
    sharp = spot(None)
    focused = spot(Effects(aperture=15.0, focus_distance=300.0))
    blurred = spot(Effects(aperture=15.0, focus_distance=320.0, aperture_rays=256))
    assert np.abs(focused - sharp).max() < 0.02 * sharp.max()
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.01)
    steps = np.arange(41) - 20.0
    second = [(image.sum(axis=0) * steps**2).sum() / image.sum() for image in (sharp, blurred)]
    disc = 15.0 * (1 - 300 / 320) / 300 * 3000  # its diameter in pixels
    assert second[1] - second[0] == pytest.approx(disc**2 / 16, rel=0.05)


def test_no_pixel_that_a_lens_blurs_the_box_into_is_left_out():
    one = camera("near", (60.0, 5.0, 9.0), focal=250.0, size=(90, 90))
    effects = Effects(aperture=12.0, focus_distance=40.0)
    rays = effects.rays(one)
    hits = (enter_box(rays, GRID).length > 0).reshape(-1, effects.rays_per_pixel()).any(axis=1)
    seen = effects.pixels_that_see(one, GRID)
    pinhole = Effects().pixels_that_see(one, GRID)
    assert set(np.flatnonzero(hits)) <= set(seen.tolist())
    assert len(pinhole) < hits.sum() < hits.size
    assert len(seen) < 2 * hits.sum()


def test_the_focus_distance_may_be_the_lens_s():
    lens = camera("lens", (310.0, 43.0, 17.0), optics=Optics(focus_distance=250.0))
    stated = Effects(aperture=20.0, focus_distance=250.0).rays(RIG[0], np.array([600]))
    known = Effects(aperture=20.0).rays(lens, np.array([600]))
    np.testing.assert_array_equal(known.directions, stated.directions)
    with pytest.raises(ValueError, match="focus_distance: camera side: found none with an ap"):
        simulate_images(RIG, BLOBS, GRID, effects=Effects(aperture=20.0))


def test_a_pixel_that_does_not_look_at_the_plane_in_focus_is_refused():
    wide = camera("wide", (9.0, 1.0, 2.0), focal=0.004)
    with pytest.raises(ValueError, match="camera wide: found a pixel that does not look at"):
        Effects(aperture=1.0, focus_distance=5.0).rays(wide)


@pytest.mark.parametrize("all_active", [True, False])
def test_lengths_times_the_true_ratio_project_to_the_images(all_active):
    """A learned correction of the segment lengths should come to this ratio."""
    effects = replace(EVERYTHING, aperture=0.0, gain_spread=0.2)
    volume = sample(BLOBS, GRID, 2)
    if not all_active:
        volume[volume < 0.05] = 0
    scan = simulate_images(RIG, SampledField(volume, GRID), GRID, effects=effects, seed=4)
    active = ActiveVoxels.from_mask(GRID, np.ones(GRID.shape) if all_active else volume > 0)
    system = LinearSystem.from_rig(RIG, GRID, midpoints=True, active=active)
    emission = active.compress(volume)
    gains = effects.gains(2, seed=4)
    images = []
    for view, (one, gain) in enumerate(zip(RIG, gains, strict=True)):
        segments = system.projector.view(view).segments
        ratio = effects.weight_ratio(one, segments, GRID, emission, gain=gain)
        assert ratio.shape == (len(segments),)
        length = (segments.length * ratio).astype(np.float32)
        images.append(Projector(replace(segments, length=length), GRID, active=active) @ emission)
    measured = system.flatten(list(scan.images.values()))
    assert active.size < GRID.size or all_active
    np.testing.assert_allclose(np.concatenate(images), measured, rtol=1e-4, atol=1e-5)


def test_the_ratio_needs_midpoints_and_for_self_absorption_the_emission():
    segments = trace(Rays.from_camera(RIG[0]), GRID)
    with pytest.raises(ValueError, match="segments midpoint: found none"):
        Effects().weight_ratio(RIG[0], segments, GRID)
    segments = trace(Rays.from_camera(RIG[0]), GRID, midpoints=True)
    with pytest.raises(ValueError, match="emission: found none"):
        Effects(self_absorption=1.0).weight_ratio(RIG[0], segments, GRID)
    assert (Effects(aperture=3.0).weight_ratio(RIG[0], segments, GRID) == 1).all()
    nothing = segments.rows(0, 1)
    assert len(nothing) == 0
    assert Effects(absorption=1.0).weight_ratio(RIG[0], nothing, GRID).shape == (0,)


def test_effects_print_as_what_they_are():
    assert eval(repr(EVERYTHING)) == EVERYTHING
    assert not Effects().any
    assert not Effects(focus_distance=3.0, aperture_rays=9).any
    scan = simulate_images(RIG, BLOBS, GRID, effects=EVERYTHING)
    assert Effects(**scan.settings["effects"]) == EVERYTHING


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gain_spread": -0.1}, "gain_spread: found -0.1, expected a number >= 0"),
        ({"absorption": float("nan")}, "absorption: found nan"),
        ({"self_absorption": -1}, "self_absorption: found -1"),
        ({"vignetting": 1.0}, "vignetting: found 1.0, expected a fraction below 1"),
        ({"aperture": float("inf")}, "aperture: found inf"),
        ({"focus_distance": 0}, "focus_distance: found 0, expected a number > 0"),
        ({"aperture_rays": 0}, "aperture_rays: found 0, expected a whole number >= 1"),
        ({"aperture_rays": 2.5}, "aperture_rays: found 2.5"),
        ({"aperture_rays": float("inf")}, "aperture_rays: found inf"),
    ],
)
def test_bad_values(values, message):
    with pytest.raises(ValueError, match=message):
        Effects(**values)
