"""Gas of a scene: extinction on other voxels, solids in the box, files."""

import numpy as np
import pytest

from rigs.scene.gas import ExtinctionVolume, Gas, IndexVolume, read_gas


class Ball:
    name = "bead"

    def __init__(self, center, radius):
        self.center, self.radius = np.array(center), radius

    def contains(self, points):
        return np.linalg.norm(points - self.center, axis=1) < self.radius

    def samples(self):
        around = np.random.default_rng(0).normal(size=(200, 3))
        return self.center + self.radius * around / np.linalg.norm(around, axis=1, keepdims=True)


def smoke():
    return ExtinctionVolume(
        np.random.default_rng(1).random((5, 4, 6)), (-1.0, 2.0, 0.5), (0.5, 0.7, 0.3)
    )


def test_means_over_other_voxels_hold_as_much():
    volume = smoke()
    lower, spacing, shape = np.array([-2.0, 1.0, -1.0]), np.array([0.3, 0.4, 0.45]), (15, 12, 10)
    means = volume.means(lower, spacing, shape)  # a box around it
    assert means.shape == shape
    np.testing.assert_allclose(
        means.sum() * spacing.prod(), volume.values.sum() * volume.spacing.prod(), rtol=1e-12
    )
    inside = volume.means(volume.lower + 0.1, (0.2, 0.2, 0.15), (1, 1, 1))
    np.testing.assert_allclose(inside, volume.values[0, 0, 0], rtol=1e-12)


def test_means_over_its_own_voxels_are_its_values():
    volume = smoke()
    same = volume.means(volume.lower, volume.spacing, volume.values.shape)
    np.testing.assert_array_equal(same, volume.values)


def test_lengths_scale_with_the_world():
    volume, factor = smoke(), 25.4
    scaled = volume.with_lengths_scaled(factor)
    np.testing.assert_allclose(scaled.values * scaled.spacing[0], volume.values * 0.5)
    bends = IndexVolume(1 + 0.01 * smoke().values, (0, 0, 0), 1.0)
    ray = np.array([[-1.0, 2, 2]]), np.array([[1.0, 0, 0.1]])
    there = bends.cross(*ray)
    far = Gas(bends).with_lengths_scaled(factor).index.cross(factor * ray[0], ray[1])
    np.testing.assert_allclose(far.exit_origins, factor * there.exit_origins, rtol=1e-12)


@pytest.mark.parametrize(
    ("ball", "fits"),
    [
        (Ball((0, 0, 0), 0.5), False),
        (Ball((1, 1, 1), 0.3), False),
        (Ball((0, 0, 0), 9.0), False),
        (Ball((2.0, 0, 0), 0.9), True),
    ],
    ids=["inside", "corner", "around", "beside"],
)
def test_solids_in_the_box_are_refused(ball, fits):
    gas = Gas(IndexVolume(np.full((4, 4, 4), 1.001), (-1, -1, -1), 0.5))
    if fits:
        gas.check([ball])
    else:
        with pytest.raises(ValueError, match="solid bead: reaches into the box of the refractive"):
            gas.check([ball])
    Gas(extinction=smoke()).check([ball])


def test_gas_in_another_medium_is_refused():
    with pytest.raises(ValueError, match=r"found 1 at its faces in a medium of 1\.33"):
        Gas(IndexVolume(np.full((2, 2, 2), 1.4), (0, 0, 0), 1)).check([], 1.33)


def save(path, values, **more):
    arrays = {"data": values, "origin": [0.5, 0.5, 0.5], "spacing": [1.0, 1.0, 1.0]} | more
    np.savez(path, **arrays)


def test_files_are_read(tmp_path):
    index = 1 + 3e-4 * smoke().values
    save(tmp_path / "n.npz", index, length_unit="mm")
    save(tmp_path / "k.npz", smoke().values.astype(np.float32))
    gas = read_gas(tmp_path, "mm", index="n.npz", extinction="k.npz", medium=1.0)
    np.testing.assert_array_equal(gas.index.values, index)
    np.testing.assert_array_equal(gas.index.lower, [0, 0, 0])
    np.testing.assert_array_equal(gas.extinction.upper, [5, 4, 6])
    assert not read_gas(tmp_path, "mm")


@pytest.mark.parametrize(
    ("values", "more", "message"),
    [
        (1 + smoke().values, {"length_unit": "m"}, "length_unit: found m, expected mm"),
        (1 + 3e-5 * smoke().values.astype(np.float32), {}, "found float32, in steps of 1e-07"),
        (smoke().values, {}, "n itself, not n - 1"),
        (1 + smoke().values, {"origin": [0.0]}, r"found \(1,\)"),
        (1j * smoke().values, {}, "expected real numbers"),
    ],
)
def test_files_are_checked(tmp_path, values, more, message):
    save(tmp_path / "n.npz", values, **more)
    with pytest.raises(ValueError, match=f"gas: index: n.npz: .*{message}") as caught:
        read_gas(tmp_path, "mm", index="n.npz")
    assert "\n" not in str(caught.value)


def test_files_stay_in_the_folder(tmp_path):
    save(tmp_path / "n.npz", 1 + smoke().values)
    folder = tmp_path / "rig"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"gas: index: found .* inside the rig's folder"):
        read_gas(folder, "mm", index="../n.npz")
    with pytest.raises(FileNotFoundError, match="no such file, which scene: gas: index names"):
        read_gas(folder, "mm", index="n.npz")
    (folder / "k.npz").write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"gas: extinction: k\.npz: not a readable \.npz"):
        read_gas(folder, "mm", extinction="k.npz")


def test_negative_extinction_is_refused():
    with pytest.raises(
        ValueError, match=r"found -0.1 in voxel \(0, 0, 0\), expected numbers >= 0"
    ):
        ExtinctionVolume(np.full((2, 2, 2), -0.1), (0, 0, 0), 1)
