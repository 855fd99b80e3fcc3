"""The visual hull of opaque things: what carving leaves of exact silhouettes."""

from types import SimpleNamespace

import numpy as np
from scipy import ndimage

import rigs
from rigs.formats import middlebury
from tomo import VoxelGrid
from tomo.hull.dark_votes import dark_votes, touched
from tomo.hull.projection_lattice import Lattice

GRID = VoxelGrid((40, 40, 40), 0.5)


def visual_hull(cameras, silhouettes, grid):
    """Return the voxels that no silhouette excludes, and the pixels that see them."""
    lattices = Lattice.of_all(cameras, grid)
    inside = dark_votes(silhouettes, lattices, grid.shape, margin=0.0, enough=1) == 0
    images = touched(inside, lattices, [own.shape for own in silhouettes])
    common = np.array([np.count_nonzero(a & b) for a, b in zip(images, silhouettes, strict=True)])
    either = np.array([np.count_nonzero(a | b) for a, b in zip(images, silhouettes, strict=True)])
    with np.errstate(invalid="ignore"):
        return SimpleNamespace(inside=inside, images=images, overlaps=common / either)


def silhouettes(rig, radius, center=(0, 0, 0)):
    """Exact silhouettes of a ball: pixels whose ray passes within its radius."""
    found = []
    for camera in rig:
        origins, directions = camera.rays()
        apart = np.asarray(center) - origins
        along = (apart * directions).sum(-1)
        near = (apart**2).sum(-1) - along**2 <= radius**2
        found.append(near.reshape(camera.image_size[::-1]))
    return found


def test_the_hull_of_a_ball_holds_it_and_little_more():
    rig = rigs.ring(
        24, distance=200, image_size=(80, 80), footprint=0.3, pitch_degrees=[30, -30] * 12
    )
    seen = silhouettes(rig, 7.0, (1, -1, 0.5))
    hull = visual_hull(tuple(rig), seen, GRID)
    apart = np.linalg.norm(GRID.centers() - (1, -1, 0.5), axis=-1)
    assert hull.inside[apart < 7.0 - 0.3].all()
    assert not hull.inside[apart > 7.0 + 2.0].any()
    # larger by a voxel's diagonal and a pixel at most
    assert (hull.overlaps > (7.0 / (7.0 + 0.5 * 3**0.5 + 0.3)) ** 2).all()


def test_finer_voxels_fit_the_silhouettes_better():
    rig = rigs.ring(8, distance=200, image_size=(80, 80), footprint=0.3)
    seen = silhouettes(rig, 7.0)
    coarse, fine = (visual_hull(tuple(rig), seen, GRID.refined(n)) for n in (1, 3))
    assert fine.overlaps.mean() > coarse.overlaps.mean()
    # every set pixel is covered: an outer hull loses nothing
    assert all(
        (hull & own).sum() >= 0.995 * own.sum()
        for hull, own in zip(fine.images, seen, strict=True)
    )


def test_an_empty_silhouette_leaves_nothing():
    rig = rigs.ring(3, distance=200, image_size=(80, 80), footprint=0.3)
    seen = silhouettes(rig, 5.0)
    seen[1] = np.zeros_like(seen[1])
    hull = visual_hull(tuple(rig), seen, GRID)
    assert not hull.inside.any()
    assert np.isnan(hull.overlaps[1])
    assert hull.overlaps[0] == 0


def test_the_dinosaur_of_middlebury(test_data):
    """Sixteen calibrated photographs: the hull re-projects onto the silhouettes it is made of."""
    import cv2

    folder = test_data / "dino_sparse_ring"
    rig = middlebury.load(folder / "dinoSR_par.txt")
    seen = []
    for name in rig.names:
        bright = cv2.imread(str(folder / f"{name}.png")).max(axis=2) > 0.19 * 255
        # the figure has dark folds: grown by ten pixels they close, seven are taken back
        grown = ndimage.binary_dilation(bright, iterations=10)
        seen.append(ndimage.binary_erosion(grown, iterations=7))
    grid = VoxelGrid.from_bounds(
        (216, 216, 216), (-0.065897, -0.022874, -0.061845), (0.014897, 0.072227, 0.019495)
    )
    hull = visual_hull(tuple(rig), seen, grid)
    assert hull.overlaps.mean() >= 0.95
    assert hull.overlaps.min() >= 0.925
