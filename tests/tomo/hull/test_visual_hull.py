"""The visual hull of opaque things: what carving leaves of exact silhouettes."""

import json

import numpy as np
import pytest

import rigs
from tomo import VoxelGrid
from tomo.hull import visual_hull
from tomo.hull.opaque import otsu, silhouette
from tomo.io import read_volume
from tomo.scan import save_scan

GRID = VoxelGrid((40, 40, 40), 0.5)


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


def test_silhouettes_are_parted_closed_and_grown():
    image = np.full((60, 80), 0.05) + 0.02 * np.random.default_rng(0).random((60, 80))
    image[10:40, 0:30] = 0.8
    image[20:24, 0:30] = 0.05  # a dark fold, to the image's edge
    level = otsu([image, image])
    assert 0.07 < level < 0.8
    closed = silhouette(image, level, close=5)
    assert closed[15:35, 2:25].all()
    assert not closed[41:].any()
    assert not closed[:, 31:].any()
    grown = silhouette(image, level, close=5, grow=3)
    assert grown[15, 32]
    assert not grown[15, 33]
    assert not silhouette(image, 0.9, close=5, grow=2).any()
    with pytest.raises(ValueError, match=r"^threshold: found images of 0\.5 alone"):
        otsu([np.full((3, 3), 0.5)])


@pytest.mark.parametrize("is_binary", [False, True])
def test_the_command_writes_the_hull_and_how_well_it_fits(run_tool, tmp_path, is_binary):
    rig = rigs.ring(12, distance=200, image_size=(80, 80), footprint=0.3, pitch_degrees=10)
    images = {c.name: 0.7 * own for c, own in zip(rig, silhouettes(rig, 7.0), strict=True)}
    if is_binary:  # white on black in 8 bits: the thing is at full scale
        images = {name: np.where(own > 0, 255, 0).astype(np.uint8) for name, own in images.items()}
    save_scan(tmp_path / "scan", rig, {"one": images}, grid=GRID)
    options = ("--close", "0", "--grow", "0", "-o", tmp_path / "out", "--json")
    done = run_tool("hull", tmp_path / "scan", *options)
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert report == json.loads((tmp_path / "out" / "hull.json").read_text())
    assert report["iou"] > 0.8
    assert set(report["views"]) == set(rig.names)
    data, grid, _ = read_volume(tmp_path / "out" / "hull.npz")
    assert grid == GRID
    assert report["volume"] == pytest.approx(data.sum() * 0.5**3)
    assert report["volume"] > 4 / 3 * np.pi * 7**3
    bad = run_tool("hull", tmp_path / "scan", "--channel", "g", "-o", tmp_path / "bad")
    assert bad.exit_code == 2
    assert len(bad.stderr.splitlines()) == 1


def test_the_dinosaur_of_middlebury(run_tool, test_data, tmp_path):
    """Sixteen calibrated photographs: the hull re-projects onto the silhouettes it is made of."""
    folder = test_data / "dino_sparse_ring"
    done = run_tool(
        "hull", "--rig", folder / "dinoSR_par.txt", "--images", folder, "--channel", "r",
        "--grid", "324x382x326", "--spacing", "0.00025", "--center", "-0.0255,0.0247,-0.0212",
        "--threshold", "0.15", "--close", "10", "--grow", "3", "-o", tmp_path / "out", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["iou"] >= 0.96
    assert min(report["views"].values()) >= 0.95
