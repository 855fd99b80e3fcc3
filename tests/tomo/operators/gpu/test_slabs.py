"""A volume in slabs on a device: the lengths of the whole, one slab at a time."""

import re

import numpy as np
import pytest
from test_host_build import GRIDS, KINDS, oracle_of, rays_of, rows_of

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, LinearSystem, dot_test
from tomo.operators.gpu import DeviceError, DeviceProjector, DeviceSlabs, on_device, to_device
from tomo.operators.gpu.wanted import on_cpu
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.solvers import cgls

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    3, distance=400.0, image_size=(26, 24), footprint=0.8, center=GRID.center, pitch_degrees=20.0
)
SOME = ActiveVoxels.from_mask(GRID, np.random.default_rng(0).random(GRID.shape) < 0.4)


@pytest.mark.parametrize("name", ["exact in binary", "rounded, off the origin"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_ray_in_a_face_between_slabs_is_counted_once(name, kind, host):
    grid = GRIDS[name]
    rays, edge = rays_of(kind, grid), min(grid.spacing)
    exact = oracle_of(rays, grid).to_scipy().toarray()
    for count in (2, grid.shape[0]):
        found = rows_of(DeviceSlabs(OnTheFlyProjector(rays, grid), host, count))
        assert np.abs(found - exact).max() < 1e-11 * edge


@pytest.fixture(params=["all", "some"])
def flying(request):
    active = ActiveVoxels(GRID) if request.param == "all" else SOME
    return OnTheFlyProjector([pixel_source(one, None, 2) for one in RIG], GRID, active=active)


@pytest.mark.parametrize("count", [2, 4, 9])
def test_products_are_those_of_the_whole(flying, host, count):
    whole, slabs = DeviceProjector(flying, host), DeviceSlabs(flying, host, count)
    assert len(slabs.slabs) == count
    random = np.random.default_rng(1)
    for shape in ((), (3,), (5,)):
        x = random.random((flying.shape[1], *shape), np.float32)
        y = random.normal(size=(flying.shape[0], *shape)).astype(np.float32)
        images, back = whole @ x, whole.T @ y
        assert np.linalg.norm(slabs @ x - images) < 1e-6 * np.linalg.norm(images)
        assert np.linalg.norm(slabs.T @ y - back) < 1e-6 * np.linalg.norm(back)
        assert np.array_equal(slabs.T @ y, slabs.T @ y)
    assert dot_test(slabs, 0, np.float64) < 1e-12
    assert dot_test(slabs, 0, np.float32) < 1e-6
    part, of_whole = slabs.subset([2, 0]), whole.subset([2, 0])
    np.testing.assert_allclose(part @ x, of_whole @ x, rtol=1e-5)
    np.testing.assert_allclose(slabs.view(1).column_sums, whole.view(1).column_sums, rtol=1e-12)


class Small:
    """A device with as much free memory as an operator needs but for a part of its volume."""

    name = "small"

    def __init__(self, device, free):
        self._device, self._free = device, free

    def __getattr__(self, name):
        return getattr(self._device, name)

    def free_bytes(self):
        return self._free


def needed(system):
    """Return the bytes of the rays of a system, and those of its volume."""
    rays = system.projector.shape[0] * (65 + 24)
    return rays, 28 * GRID.size


@pytest.mark.parametrize("linear", [False, True])
def test_what_does_not_fit_is_cut(host, linear):
    system = LinearSystem.from_rig(RIG, GRID, form="on-the-fly")
    own = system.with_linear_basis() if linear else system
    rays, volume = needed(system)
    blur = 128 * system.projector.shape[0] * linear
    free = rays + blur + volume // 2
    moved, place = on_device(own.projector, Small(host, free))
    assert place == "computed on small"
    slabs = moved.without_blur if linear else moved
    assert isinstance(slabs, DeviceSlabs)
    assert len(slabs.slabs) == 3  # of whole planes: 4 of 9 fit
    measured = own.projector @ np.random.default_rng(0).random(GRID.size, np.float32)
    volume, there = cgls(own.projector, measured).volume, cgls(moved, measured).volume
    assert np.linalg.norm(there - volume) < 1e-4 * np.linalg.norm(volume)
    assert isinstance(on_cpu(moved), type(own.projector))
    gas = own.with_absorption(Absorption(0.05)).projector
    as_gas = type(own)(moved, own.rig, own.pixels, own.form).with_absorption(Absorption(0.05))
    x = np.ones(GRID.size, np.float32)
    assert np.array_equal(as_gas.projector @ x, gas @ x)


def test_what_fits_in_no_slab_is_refused(host):
    system = LinearSystem.from_rig(RIG, GRID, form="on-the-fly")
    rays, volume = needed(system)
    line = r"GPU: small: 0\.00 GB needed and 0\.00 GB free; \d+ voxels would fit, found 720"
    gas = AttenuatedProjector(system.projector, Absorption(0.05))
    for operator, free in ((system.projector, rays), (gas, rays + volume // 2)):
        with pytest.raises(DeviceError) as caught:
            to_device(operator, Small(host, free))
        assert re.fullmatch(line, str(caught.value))
