import gc
from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from tomo import Options, Scan, VoxelGrid
from tomo.operators import LinearSystem

COUNT = 11  # one whole block, and three frames of another


def moving_blobs(grid, time):
    """Return two blobs that rise and turn, as a volume of the grid."""
    x, y, z = np.moveaxis(grid.centers(), -1, 0)
    volume = np.zeros(grid.shape)
    for phase, height in ((0.0, 0.0), (2.2, 5.0)):
        angle = phase + 0.12 * time
        cx, cz = 2.5 * np.cos(angle), 2.5 * np.sin(angle)
        cy = (height + 0.3 * time + 4) % 8 - 4
        volume += np.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / 4)
    return np.where(volume > 0.02, volume, 0).astype(np.float32)


@pytest.fixture(scope="module", autouse=True)
def soon_collected():
    """Runs collect garbage after every block: leave what is loaded already out of that."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="session")
def film(as_given):
    """Return a film of moving blobs in five small views: scan, truths, grid and options."""
    grid = VoxelGrid((12, 14, 12), 1.0)
    rig = rigs.ring(5, distance=200.0, image_size=(24, 26), footprint=0.8, pitch_degrees=12.0)
    system = LinearSystem.from_rig(rig, grid, skip=False)
    truths = [moving_blobs(grid, time) for time in range(COUNT)]
    rng = np.random.default_rng(3)
    images = {name: [] for name in rig.names}
    for truth in truths:
        for name, image in zip(
            rig.names, system.images(system.projector @ truth.ravel()), strict=True
        ):
            images[name].append(image + rng.normal(0, 0.02, image.shape).astype(np.float32))
    images = {name: np.array(each) for name, each in images.items()}
    options = Options(  # the rig is exact, and frames stand for themselves: others test that
        frames=":", hold_out=(rig.names[2],), key_frames=2, temporal="off", **as_given
    )
    scan = Scan.from_arrays(rig, images, grid)
    return SimpleNamespace(
        scan=scan, truths=truths, grid=grid, rig=rig, images=images, options=options
    )


@pytest.fixture(scope="session")
def plan(film, choose_quickly):
    """Return the plan of the film."""
    from tomo.series import make_plan

    with choose_quickly():
        return make_plan(film.scan, film.grid, film.options, tuple(range(COUNT)))


@pytest.fixture
def store(plan, tmp_path):
    """Return a store for the plan, without a frame."""
    from tomo.series import SeriesStore
    from tomo.series.same_run import attributes_of_plan, attributes_of_run

    attributes = attributes_of_run(plan.scan, plan.grid, plan.options, plan.places)
    attributes |= attributes_of_plan(plan)
    frames = list(plan.places)
    return SeriesStore.create(tmp_path / "out.zarr", plan.grid, frames, frames, attributes)


@pytest.fixture(scope="session")
def undisturbed(film, tmp_path_factory, choose_quickly):
    """Return the store of the film, made in one go."""
    from tomo.series import reconstruct_series

    path = tmp_path_factory.mktemp("undisturbed") / "out.zarr"
    with choose_quickly():
        return reconstruct_series(film.scan, path, options=film.options)


@pytest.fixture(scope="session")
def contents():
    """Return a function: a store to its arrays, but for wall times."""

    def read(store):
        return {n: a[:] for n, a in store.group.arrays() if n != "seconds"}

    return read


@pytest.fixture(scope="session")
def assert_same(contents):
    """Return a function that raises unless two stores hold the same bits."""

    def check(one, other):
        ours, theirs = contents(one), contents(other)
        assert ours.keys() == theirs.keys()
        for name, values in ours.items():
            assert values.tobytes() == theirs[name].tobytes(), name

    return check
