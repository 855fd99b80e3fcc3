from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import ring
from rigs.lens import Distortion
from tomo import LinearSystem, VoxelGrid
from tomo.hull import carve
from tomo.hull.darkness import Brightness
from tomo.hull.margins import CARVED_AWAY, UNEXPLAINED
from tomo.measurement import NoiseModel
from tomo.simulation import camera_noise

GRID = VoxelGrid((16, 24, 18), 0.5, (1.0, -2.0, 0.5))
SIZE = (60, 72)  # width, height


def rig_of(count, **settings):
    how = {"distance": 90.0, "image_size": SIZE, "footprint": 0.25, "pitch_degrees": 10.0}
    return ring(count, center=GRID.center, **{**how, **settings})


def ball(radius=2.0, at=(0.0, 0.0, 0.0)):
    """Return a bright ball with a soft edge: (nx, ny, nz)."""
    away = np.linalg.norm(GRID.centers() - GRID.center - at, axis=-1)
    return np.maximum(1 - (away / radius) ** 2, 0)


def images_of(rig, volume):
    system = LinearSystem.from_rig(rig, GRID)
    return system.images((system.projector @ volume.ravel()).astype(np.float32))


def lost(carving, volume):
    """Return the share of a volume's energy outside the active voxels."""
    return np.sum(volume[~carving.active.mask] ** 2) / np.sum(volume**2)


@given(
    count=st.integers(2, 6),
    pitch=st.floats(-40, 40),
    start=st.floats(0, 90),
    distance=st.floats(40, 2000),
    footprint=st.floats(0.15, 0.6),
    bend=st.floats(-0.3, 0.3),
    seed=st.integers(0, 2**16),
)
@settings(max_examples=25)
def test_exact_cameras_never_lose_a_voxel_that_emits(
    count, pitch, start, distance, footprint, bend, seed
):
    rig = rig_of(
        count, pitch_degrees=pitch, start_degrees=start, distance=distance, footprint=footprint
    )
    bent = [replace(c, distortion=Distortion("brown", (bend, 0, 0.01, 0))) for c in rig]
    rig = replace(rig, cameras=tuple(bent))
    random = np.random.default_rng(seed)
    volume = np.zeros(GRID.shape)
    for _ in range(random.integers(1, 4)):
        volume += ball(random.uniform(0.4, 2.5), random.uniform(-3, 3, 3))
    if not volume.any():
        return
    found = carve(tuple(rig), images_of(rig, volume), None, GRID, threshold=0.0)
    assert not volume[~found.active.mask].any()
    assert found.margin == 0
    faint = carve(tuple(rig), images_of(rig, volume), None, GRID)
    assert lost(faint, volume) < 1e-3


def test_a_ball_is_cut_out_of_the_box():
    rig = rig_of(8)
    volume = ball()
    found = carve(tuple(rig), images_of(rig, volume), None, GRID)
    emits = np.count_nonzero(volume) / GRID.size
    assert emits < found.active.size / GRID.size < 2.5 * emits
    assert lost(found, volume) < 1e-4
    assert found.margin == 0
    assert found.unexplained <= UNEXPLAINED


def test_the_kept_pixels_are_all_that_see_a_live_voxel():
    rig = rig_of(5)
    found = carve(tuple(rig), images_of(rig, ball()), None, GRID)
    system = LinearSystem.from_rig(rig, GRID)
    meets = system.images(system.projector @ found.active.mask.ravel().astype(np.float32))
    for kept, length in zip(found.pixels, meets, strict=True):
        assert kept[length > 0].all()
        assert kept.mean() < 0.6


def cropped(camera, image, columns):
    """Return a camera that records only the first columns of its image, and what it records."""
    narrow = replace(camera, image_size=(columns, SIZE[1]))
    return narrow, np.ascontiguousarray(image[:, :columns])


def seen_by(camera, volume):
    """Return which voxels' centres a camera sees: (nx, ny, nz)."""
    uv, _, valid = camera.project(GRID.centers().reshape(-1, 3))
    inside = valid & (uv > -0.5).all(axis=1) & (uv < np.array(camera.image_size) - 0.5).all(axis=1)
    return inside.reshape(volume.shape)


def test_voxels_beyond_a_dark_border_are_empty_and_beyond_a_bright_one_not():
    rig, volume = rig_of(4), ball(1.5)
    images = images_of(rig, volume)
    whole = carve(tuple(rig), images, None, GRID)
    for columns, cuts in ((42, False), (30, True)):
        camera, image = cropped(rig[0], images[0], columns)
        assert (image[:, -1].max() > 0.1 * image.max()) == cuts
        found = carve((camera, *rig[1:]), [image, *images[1:]], None, GRID)
        assert lost(found, volume) < 1e-4
        out_of_view = ~seen_by(camera, volume)
        assert out_of_view.any()
        assert (found.active.mask & out_of_view).any() == cuts
        assert cuts or found.active.size == whole.active.size


def test_a_second_flame_out_of_one_view_stays():
    rig = rig_of(6)
    volume = ball(1.5, (-1.5, 0, 0)) + ball(1.0, (2.5, 0, 0))
    images = images_of(rig, volume)
    for number, camera in enumerate(rig):
        for columns in (26, 34):
            narrow, image = cropped(camera, images[number], columns)
            cameras = [*rig[:number], narrow, *rig[number + 1 :]]
            found = carve(cameras, [*images[:number], image, *images[number + 1 :]], None, GRID)
            assert lost(found, volume) < 1e-3
            assert found.active.size < 0.7 * GRID.size


def shifted(camera, pixels):
    matrix = camera.camera_matrix.copy()
    matrix[:2, 2] += np.multiply(pixels, [1, -1])
    return replace(camera, camera_matrix=matrix)


@pytest.mark.parametrize("shift", [4.0, 6.0])
def test_a_camera_that_is_off_widens_the_margin(shift):
    rig = rig_of(6)
    volume = ball(2.0, (0.5, 1.0, 0.5))
    images = images_of(rig, volume)
    cameras = (shifted(rig[0], shift), *rig[1:])
    trusting = carve(cameras, images, None, GRID, margin=0)
    found = carve(cameras, images, None, GRID)
    assert trusting.unexplained > UNEXPLAINED >= found.unexplained
    assert 0 < found.margin <= shift
    assert lost(found, volume) < min(0.1 * lost(trusting, volume), 5e-3)
    assert found.active.size < 0.7 * GRID.size


def test_cameras_that_are_all_off_by_a_pixel():
    rig = rig_of(9)
    volume = ball(2.0, (0.5, 1.0, 0.5))
    random = np.random.default_rng(5)
    cameras = [shifted(camera, random.normal(0, 1, 2)) for camera in rig]
    assert lost(carve(cameras, images_of(rig, volume), None, GRID), volume) < 5e-3


def test_one_view_that_is_dark_altogether_proves_nothing():
    """A shutter that stayed closed contradicts all the others."""
    rig = rig_of(6)
    volume = ball()
    images = images_of(rig, volume)
    images[2][:] = 0
    found = carve(tuple(rig), images, None, GRID)
    assert lost(found, volume) < 1e-3
    assert found.votes > 1 or found.active.all


@pytest.mark.parametrize("count", [8, 24])
def test_noise_of_a_tenth_of_the_maximum(count):
    rig = rig_of(count)
    volume = ball(2.5)
    noisy = camera_noise.gaussian(images_of(rig, volume), 0.1, np.random.default_rng(3))
    found = carve(tuple(rig), noisy, None, GRID)
    assert found.smoothing > 0
    assert found.noise[0].read == pytest.approx(0.1 * np.max(images_of(rig, volume)), rel=0.2)
    assert lost(found, volume) < 2e-3
    assert found.active.size < 0.4 * GRID.size


def test_photon_noise_and_dead_pixels():
    rig = rig_of(8)
    volume = ball(2.5)
    counts = camera_noise.poisson(images_of(rig, volume), 200, 1.0, np.random.default_rng(3))
    for image in counts:
        image[::7, ::5] = 0  # dead, in the flame too
        image[3, 4] = np.nan
    found = carve(tuple(rig), counts, None, GRID)
    assert lost(found, volume) < 1e-3
    assert found.active.size < 0.5 * GRID.size


def test_all_dark_carves_nothing():
    rig = rig_of(3)
    dark = [np.zeros(SIZE[::-1], np.float32)] * 3
    found = carve(tuple(rig), dark, None, GRID)
    assert found.active.all
    assert "no pixel is certainly bright" in found.reason
    noisy = camera_noise.gaussian([image + 1 for image in dark], 0.5, np.random.default_rng(0))
    assert carve(tuple(rig), [image - 1 for image in noisy], None, GRID).active.all


def test_nothing_dark_carves_nothing():
    rig = rig_of(3)
    bright = [np.ones(SIZE[::-1], np.float32)] * 3
    found = carve(tuple(rig), bright, None, GRID)
    assert found.active.all
    assert "0.0% of the voxels are dark" in found.reason


def test_an_infinite_margin_carves_nothing():
    rig = rig_of(3)
    assert carve(tuple(rig), images_of(rig, ball()), None, GRID, margin=np.inf).active.all


def test_a_saturated_core_that_is_masked_stays_live():
    rig = rig_of(6)
    volume = ball(2.5)
    images = images_of(rig, volume)
    level = 0.5 * max(image.max() for image in images)
    masks = [image < level for image in images]
    recorded = [np.where(mask, image, 0) for image, mask in zip(images, masks, strict=True)]
    found = carve(tuple(rig), recorded, masks, GRID)
    assert lost(found, volume) < 1e-3
    assert not any((kept & ~mask).any() for kept, mask in zip(found.pixels, masks, strict=True))


def test_masked_pixels_never_vote():
    rig = rig_of(4)
    volume = ball(2.0)
    images = images_of(rig, volume)
    masks = [np.ones(SIZE[::-1], bool) for _ in rig]
    masks[1][:] = False
    images[1][:] = 0  # as a scan returns what is masked
    half = masks[3]
    half[:, : SIZE[0] // 2] = False
    images[3][~half] = 0
    found = carve(tuple(rig), images, masks, GRID, threshold=0.0)
    assert not volume[~found.active.mask].any()
    others = carve(tuple(rig), images, masks, GRID, threshold=0.0, views=[0, 2, 3])
    np.testing.assert_array_equal(found.active.mask, others.active.mask)


def test_views_that_do_not_judge_are_given_their_pixels():
    rig = rig_of(4)
    images = images_of(rig, ball())
    images[0] = np.zeros_like(images[0])
    found = carve(tuple(rig), images, None, GRID, views=[1, 2, 3])
    alone = carve(tuple(rig[1:]), images[1:], None, GRID)
    np.testing.assert_array_equal(found.active.mask, alone.active.mask)
    assert 0 < found.pixels[0].mean() < 0.6


def test_the_report_is_plain():
    import json

    rig = rig_of(3)
    found = carve(tuple(rig), images_of(rig, ball()), None, GRID)
    report = json.loads(json.dumps(found.report(rig.names)))
    assert report["active_voxels"] == found.active.size
    assert report["voxels"] == GRID.size
    assert list(report["noise"]) == list(rig.names)
    assert "of the voxels are dark in 1 or more of 3 views" in report["reason"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"margin": -1}, "margin: found -1, expected auto or a number"),
        ({"margin": "wide"}, "margin: found 'wide'"),
        ({"threshold": np.nan}, "threshold: found nan"),
        ({"votes": 0}, "votes: found 0, expected auto or a whole number from 1"),
        ({"images": [np.zeros(SIZE[::-1])]}, "images: found 1, expected one for each of 3"),
        ({"masks": [np.ones((2, 2), bool)] * 3}, r"masks: camera cam00: found shape \(2, 2\)"),
    ],
)
def test_what_does_not_fit_is_refused(changes, message):
    images = [np.zeros(SIZE[::-1], np.float32)] * 3
    given = {"images": images, "masks": None, **changes}
    with pytest.raises(ValueError, match=message):
        carve(tuple(rig_of(3)), given.pop("images"), given.pop("masks"), GRID, **given)


def core_with_halo():
    """Return a core and a halo of a thousandth of it that holds 4 to 5 % of the light."""
    volume = 1000 * ball(0.9) + ball(3.3)
    assert 0.04 < ball(3.3).sum() / volume.sum() < 0.05
    return volume


def test_a_faint_halo_in_clean_images_stays():
    rig, volume = rig_of(8), core_with_halo()
    images = images_of(rig, volume)
    full = 1.2 * np.max(images)
    recorded = [np.round(65535 * image / full).astype(np.float32) / 65535 for image in images]
    found = carve(tuple(rig), recorded, None, GRID)
    assert volume[~found.active.mask].sum() < 0.004 * volume.sum()
    assert found.light_carved_away < CARVED_AWAY
    assert found.active.size < 0.8 * GRID.size
    assert not found.warnings


def test_a_halo_below_the_dark_level_makes_the_margin_grow():
    rig, volume = rig_of(8), core_with_halo()
    clean = images_of(rig, volume)
    brightest = np.max(clean)
    random = np.random.default_rng(2)
    noisy = [image + 3e-4 * brightest * random.standard_normal(image.shape) for image in clean]
    trusting = carve(tuple(rig), noisy, None, GRID, threshold=5e-3 * brightest, margin=0)
    found = carve(tuple(rig), noisy, None, GRID, threshold=5e-3 * brightest)
    assert trusting.light_carved_away > CARVED_AWAY
    assert "missing in the volume" in trusting.warnings[0]
    assert found.faint_light == trusting.light_carved_away
    assert found.light_carved_away <= CARVED_AWAY
    assert found.margin > 0
    (warning,) = found.warnings
    assert "faint light around the flame" in warning
    gone = [volume[~one.active.mask].sum() for one in (found, trusting)]
    assert gone[0] < 0.6 * gone[1]


@pytest.mark.parametrize("change", ["level", "clipped", "noise", "halo"])
def test_only_light_is_carved_away(change):
    """A level that all pixels have, noise, and noise cut off at zero are no light."""
    random = np.random.default_rng(4)
    image = np.zeros((80, 80), np.float32)
    image[30:50, 30:50] = 100
    image += random.standard_normal(image.shape).astype(np.float32)
    seen = np.zeros(image.shape, bool)
    seen[5:-5, 5:-5] = True
    if change == "level":
        image += 0.5
    if change == "clipped":
        image = np.maximum(image, 0)
    if change == "halo":
        image[20:60, 20:60] += 2.0
    explained = np.zeros(image.shape, bool)
    explained[25:55, 25:55] = True
    found = Brightness.of([image], None, 1.0, noise=[NoiseModel(1.0)])
    lost = found.carved_away([explained], [seen], [0])
    if change == "halo":  # 700 of its 1600 pixels, less two standard deviations of 4000 pixels
        light = 400 * 100 + 1600 * 2.0
        assert lost == pytest.approx((1400 - 2 * np.sqrt(4000)) / light, rel=0.2)
    else:
        assert lost < 1e-3
