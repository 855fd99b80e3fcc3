"""Films: one frame after the other, each as a still simulation of its moment."""

import numpy as np
import pytest

import rigs
from phantoms import JetFlame, create
from tomo import VoxelGrid, load_scan
from tomo.io import VolumeFilm
from tomo.simulation import simulate_film, simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((5, 10, 5), 2.0)
RIG = rigs.ring(3, distance=200.0, image_size=(10, 16), footprint=1.6)
FIELD = JetFlame(1, tuple(GRID.extent))
RATE = 100.0
SETTINGS = {"frame_rate": RATE, "supersample": 2, "refine": 2}


def made(folder, frames, **settings):
    return load_scan(
        simulate_film(RIG, FIELD, GRID, folder, frames=frames, **SETTINGS, **settings)
    )


def test_frames_without_noise_are_still_images_of_their_moments(tmp_path):
    effects = Effects(self_absorption=0.02, gain_spread=0.1, vignetting=0.1)
    scan = made(tmp_path, 10, effects=effects, seed=3)
    assert scan.frame_names == tuple(map(str, range(10)))
    assert scan.frame_rate == RATE
    for number in (0, 4, 9):
        still = simulate_images(
            RIG, FIELD.at(number / RATE), GRID, supersample=2, refine=2, effects=effects, seed=3
        )
        for image, name in zip(scan.images(str(number)), RIG.names, strict=True):
            np.testing.assert_array_equal(image, still.images[name])
        truth, grid = scan.read_truth(str(number))
        np.testing.assert_array_equal(truth, still.truth)
        assert grid == GRID
    assert scan.effects["gains"] == pytest.approx(dict(still.settings["gains"]))


def test_noise_is_of_the_seed_and_the_frame(tmp_path):
    one, again, other, clean = (
        np.array([made(tmp_path / name, 3, **noise).images(str(n)) for n in range(3)])
        for name, noise in {
            "one": {"photons": 200.0, "seed": 1},
            "again": {"photons": 200.0, "seed": 1},
            "other": {"photons": 200.0, "seed": 2},
            "clean": {},
        }.items()
    )
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)
    noise = (one - clean).reshape(3, -1)
    assert np.abs(np.corrcoef(noise) - np.eye(3)).max() < 0.25
    exposure = 200 / clean[[0, 2]].max()  # electrons a unit, of the brightest metered frame
    np.testing.assert_allclose(one * exposure, np.round(one * exposure), atol=1e-2)


def test_films_of_integers_keep_their_scale(tmp_path):
    scan = made(tmp_path, 2, bits=12)
    assert scan.corrections.bit_depth == 12
    assert scan.holds_integers()
    clean = simulate_images(RIG, FIELD, GRID, supersample=2, refine=2)
    for image, name in zip(scan.images("0"), RIG.names, strict=True):
        np.testing.assert_allclose(image, clean.images[name], atol=clean.truth.max() * 20 / 4095)


def test_a_shorter_film_replaces_a_longer_one(tmp_path):
    made(tmp_path, 4)
    assert len(made(tmp_path, 2).frames) == 2
    chunks = (tmp_path / "truth.zarr" / "emission" / "c").rglob("*")
    kept = [path for path in chunks if path.is_file()]
    film = VolumeFilm(tmp_path / "truth.zarr")
    assert film.n_frames == 2
    assert len(kept) == 2
    with pytest.raises(ValueError, match="frame 2: found 2 frames"):
        film.read(2)


def test_a_flipped_bit_of_the_truth_is_one_line_that_names_file_and_frame(tmp_path):
    scan = made(tmp_path, 2)
    file = tmp_path / "truth.zarr" / "emission" / "c" / "1" / "0" / "0" / "0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 16
    file.write_bytes(content)
    assert scan.read_truth("0")
    with pytest.raises(ValueError, match="damaged") as caught:
        scan.read_truth("1")
    assert str(caught.value).startswith(f"{file}: frame 1: ")
    assert "\n" not in str(caught.value)


def test_the_truth_is_read_by_xarray(tmp_path):
    xarray = pytest.importorskip("xarray")
    scan = made(tmp_path, 2)
    data = xarray.open_zarr(tmp_path / "truth.zarr", consolidated=False)
    assert data.emission.dims == ("time", "x", "y", "z")
    np.testing.assert_allclose(data.time, [0, 1 / RATE])
    np.testing.assert_allclose(data.y, GRID.axes()[1])
    np.testing.assert_array_equal(data.emission[1], scan.read_truth("1")[0])


def test_a_film_that_fails_leaves_nothing(tmp_path):
    class Fading:
        def at(self, time):
            return self if time < 2 / RATE else None

        def __call__(self, points):
            return FIELD(points)

    with pytest.raises(TypeError):
        simulate_film(RIG, Fading(), GRID, tmp_path / "film", frames=9, frame_rate=RATE)
    assert not [path for path in (tmp_path / "film").rglob("*") if path.is_file()]


def test_still_fields_make_still_films(tmp_path):
    blobs = create("blobs", 1, GRID.extent)
    scan = load_scan(simulate_film(RIG, blobs, GRID, tmp_path, frames=2))
    np.testing.assert_array_equal(scan.images("0"), scan.images("1"))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"frames": 0}, "frames: found 0"),
        ({"frames": 2, "frame_rate": -1.0}, "frame_rate: found -1.0"),
        ({"frames": 2, "photons": -1.0}, "photons: found -1.0"),
    ],
)
def test_says_what_is_wrong(settings, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        simulate_film(RIG, FIELD, GRID, tmp_path, **settings)
