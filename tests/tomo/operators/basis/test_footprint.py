"""The waves that a voxel's footprint and a pixel's area pass, and those that the kernel passes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion, Rig
from tomo import VoxelGrid
from tomo.operators import footprint
from tomo.operators.footprint import footprint_blur, footprint_kernel

EDGES = np.diag([1.0, 1.2, 0.9])


def edges_of(footprint, turn=None):
    """The images of a voxel's edges, in pixels; along faces where it is not turned."""
    turned = EDGES if turn is None else Rotation.random(rng=turn).as_matrix() @ EDGES
    return turned[:2].T / footprint


def passed_by(offsets, weight, waves):
    return np.cos(2 * np.pi * waves @ offsets.T) @ weight


@pytest.mark.parametrize(
    ("footprint", "supersample", "bound"),
    [
        (0.02, 1, 0.001), (0.1, 1, 0.001), (0.3, 1, 0.004), (0.6, 1, 0.17), (0.6, 2, 0.15),
        (1.0, 1, 0.34), (1.0, 2, 0.16), (1.0, 3, 0.12), (3.0, 1, 0.5),
    ],
)  # fmt: skip
def test_long_waves_pass_as_through_footprint_and_area(footprint, supersample, bound):
    """Relative to the loss; where rays are far apart, copies are lost instead of long waves."""
    angle = np.linspace(0, np.pi, 13)
    for turn in range(5):
        edges = edges_of(footprint, turn)
        offsets, weight = footprint_kernel(edges, supersample)
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=1) * min(footprint, 1) / 8
        exact = np.sinc(waves @ edges.T).prod(axis=1) * np.sinc(waves / supersample).prod(axis=1)
        found = passed_by(offsets, weight, waves)
        np.testing.assert_allclose(1 - found, 1 - exact, rtol=bound)


@pytest.mark.parametrize("footprint", [0.3, 0.4, 0.5])
def test_edges_of_voxels_are_suppressed_for_a_camera_along_faces(footprint):
    offsets, weight = footprint_kernel(edges_of(footprint))
    for side, edge in enumerate((1.0, 1.2)):
        waves = np.zeros((9, 2))
        waves[:, side] = np.linspace(0.95, 1.05, 9) * footprint / edge
        assert np.abs(passed_by(offsets, weight, waves)).max() < 0.1


def test_weights_are_symmetric_and_not_negative_and_sum_to_one():
    random = np.random.default_rng(0)
    for number in range(120):
        footprint, supersample = np.exp(random.uniform(-4, 1.5)), int(random.integers(1, 4))
        edges = edges_of(footprint, number if number % 3 else None)
        offsets, weight = footprint_kernel(edges, supersample)
        assert weight.min() >= 0
        assert weight.sum(dtype=float) == pytest.approx(1, abs=1e-6)
        mirrored = dict(zip(map(tuple, (-offsets).tolist()), weight.tolist(), strict=True))
        assert mirrored == dict(zip(map(tuple, offsets.tolist()), weight.tolist(), strict=True))


@pytest.mark.parametrize("turn", [None, 0, 1])
def test_wide_footprints_are_transformed_as_well_as_fitted(turn, monkeypatch):
    edges = edges_of(0.12, turn)
    angle = np.linspace(0, np.pi, 13)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 0.12 / 4
    found = []
    for most in (0, 1000):
        monkeypatch.setattr(footprint, "MOST_FITTED", most)
        found.append(1 - passed_by(*footprint_kernel(edges), waves))
    exact = 1 - np.sinc(waves @ edges.T).prod(axis=1) * np.sinc(waves).prod(axis=1)
    for one in found:
        np.testing.assert_allclose(one, exact, rtol=0.06)
    assert not np.array_equal(*found)


@pytest.mark.parametrize(
    ("focus", "lens"),
    [(1e9, Distortion()), (80.0, Distortion("fisheye", (1e9, 0, 0, 0)))],
    ids=["focal length", "fisheye"],
)
def test_a_voxel_wider_than_any_kernel_is_refused_before_it_takes_memory(focus, lens):
    K = [[focus, 0, 4], [0, focus, 4], [0, 0, 1]]
    camera = Camera("cam00", (9, 9), K, lens, t=[1, 1, 100])
    grid = VoxelGrid((8, 8, 8), 1.0)
    with pytest.raises(
        ValueError, match=r"basis: camera cam00: found a voxel .* expected at most"
    ):
        footprint_blur(Rig((camera,)), [np.arange(81)], np.ones(81, bool), grid)
