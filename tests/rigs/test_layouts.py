import numpy as np
import pytest

import rigs
from rigs import Volume, arc, ring

LENS = {"image_size": (80, 60), "focal_length": 50.0, "pixel_pitch": 0.01}

# Contents of the presets: number of views, degrees from one to the next, distance, pitch
ALTERNATELY = np.where(np.arange(33) % 2 == 0, 15.0, -15.0)
RANDOM = np.random.default_rng(2024).uniform(5500.0, 6500.0, 33)
PAPER = {
    "paper33_level": (33, 11.0, 5800.0, 0.0),
    "paper33_pitch": (33, 11.0, 5800.0, ALTERNATELY),
    "paper33_random": (33, 11.0, RANDOM, ALTERNATELY),
    "paper11_11deg": (11, 11.0, 5800.0, 0.0),
    "paper11_22deg": (11, 22.0, 5800.0, 0.0),
    "paper11_33deg": (11, 33.0, 5800.0, 0.0),
}
PRESETS = pytest.mark.parametrize("name", PAPER)


def angles(rig, center=(0, 0, 0)):
    x, _, z = (np.array([camera.position for camera in rig]) - center).T
    return np.rad2deg(np.arctan2(x, z))


def test_a_ring_looks_at_its_middle_from_the_given_angles_and_distances():
    center, distances = [10.0, -5.0, 3.0], [100, 120, 140, 160]
    pitch = [0, 15, -15, 30]
    rig = ring(4, 20, distances, pitch_degrees=pitch, start_degrees=-30, center=center, **LENS)
    offsets = np.array([camera.position for camera in rig]) - center
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), distances)
    np.testing.assert_allclose(angles(rig, center), [-30, -10, 10, 30], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(np.arcsin(offsets[:, 1] / distances)), pitch, atol=1e-9)
    for camera in rig:
        uv, _, valid = camera.project([center, np.add(center, [0, 1, 0])])
        np.testing.assert_allclose(uv[0], [39.5, 29.5], atol=1e-9)
        assert valid.all()
        assert uv[1, 1] < uv[0, 1]
        assert camera.camera_matrix[0, 0] == pytest.approx(5000)


def test_a_ring_closes_by_default_and_an_arc_is_symmetric():
    np.testing.assert_allclose(angles(ring(4, distance=9, **LENS)), [0, 90, 180, -90], atol=1e-9)
    np.testing.assert_allclose(angles(arc(3, 90, 9, **LENS)), [-45, 0, 45], atol=1e-9)
    np.testing.assert_allclose(angles(arc(1, 90, 9, **LENS)), [0], atol=1e-9)


def test_footprint_stands_for_the_lens():
    rig = ring(3, distance=[10, 20, 30], image_size=(9, 9), footprint=0.1)
    np.testing.assert_allclose(rig.footprint(), 0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"distance": [1, 2]}, "ring distance: .* one number or 3"),
        ({"distance": -1}, "ring distance"),
        ({"pitch_degrees": 90}, "ring pitch_degrees"),
        ({"footprint": 1.0}, "ring lens"),
        ({"focal_length": None}, "ring lens"),
    ],
)
def test_bad_layouts_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        ring(3, **({"distance": 5} | LENS | options))
    with pytest.raises(ValueError, match="ring count"):
        ring(0, distance=5, **LENS)


def test_there_is_a_preset_for_every_layout_of_the_paper():
    assert set(rigs.preset_names()) == set(PAPER)
    with pytest.raises(ValueError, match="preset: found 'paper', expected one of paper11_11deg"):
        rigs.preset("paper")


@PRESETS
def test_a_preset_is_what_its_layout_generates(name):
    count, step, distance, pitch = PAPER[name]
    shipped = rigs.preset(name)
    lens = {"image_size": shipped[0].image_size, "focal_length": 116.0, "pixel_pitch": 0.005}
    made = ring(count, step, distance, pitch_degrees=pitch, **lens)
    assert made.names == shipped.names
    assert shipped.volume == Volume((30, 140, 30), 0.5)
    for a, b in zip(made, shipped, strict=True):
        assert a.image_size == b.image_size
        np.testing.assert_allclose(a.camera_matrix, b.camera_matrix, rtol=1e-12)
        np.testing.assert_allclose(a.position, b.position, atol=2e-6)
        np.testing.assert_allclose(a.R, b.R, atol=1e-9)
        np.testing.assert_allclose(a.t, b.t, atol=2e-6)


@PRESETS
def test_every_view_holds_the_whole_box_and_little_else(name):
    rig = rigs.preset(name)
    reach = np.zeros(2)  # from the principal point to the farthest corner, pixels
    for camera in rig:
        uv, _, _ = camera.project(rig.volume.corners())
        assert camera.inside(uv).all()
        reach = np.maximum(reach, np.abs(uv - camera.camera_matrix[:2, 2]).max(axis=0))
    assert rig[0].image_size == tuple(2 * np.ceil(reach + 2))
    assert rig[0].image_size[0] <= 100
    assert rig[0].image_size[1] <= 312  # 73.2 mm of 0.237 mm at 5500 mm, pitched


@pytest.mark.parametrize(("name", "value"), [("footprint", 0.0), ("distance", -1.0)])
def test_a_length_that_is_not_positive_is_reported_as_found(name, value):
    lengths = {"distance": 100.0, "footprint": 0.5} | {name: value}
    with pytest.raises(ValueError, match=f"ring {name}: found {value}, expected"):
        ring(3, image_size=(8, 12), **lengths)
