"""Findings: sizes in the image's own unit, their errors, and what they change of the image."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import tomo
from rigs.layouts import ring

GRID = tomo.VoxelGrid((14, 16, 14), 1.0)
FLAME = phantoms.GaussianBlobs(
    [(1.0, -2.0, 0.5), (-2.0, 2.0, 1.0), (1.5, 2.5, -2.0)], [1.9, 1.6, 1.7], [1.0, 0.8, 0.9]
)


@pytest.fixture(scope="module")
def seen():
    rig = ring(
        8, distance=200.0, image_size=(40, 45), footprint=0.48,
        pitch_degrees=[(-8.0, 15.0)[n % 2] for n in range(8)],
    )  # fmt: skip
    return tomo.simulate(rig, FLAME, GRID, supersample=2, noise=0.01, seed=1)


def found_in(scan, change):
    """Return the findings on images that were changed, of which cam02 is the camera at fault."""
    images = dict(zip(scan.rig.names, scan.images(), strict=True))
    images["cam02"] = change(images["cam02"]).astype(np.float32)
    faulty = tomo.Scan.from_arrays(scan.rig, images, scan.grid)
    options = tomo.Options(method="mlem", uncertainty=0, refine_cameras="none")
    found = tomo.reconstruct(faulty, options=options).findings
    assert {one.camera for one in found} == {"cam02"}
    return {one.effect: one for one in found}


def test_a_gain_changes_its_image_by_as_much(seen):
    gain = found_in(seen, lambda image: 1.2 * image)["gain"]
    assert gain.size == pytest.approx(0.2, abs=0.02)
    assert 0 < gain.error < 0.02
    assert gain.consequence == pytest.approx(np.log(1.2), abs=0.03)
    assert gain.line == "scan.with_corrections(gain={'cam02': %.3g})" % (1 / (1 + gain.size))


def test_a_background_is_of_the_brightest_light_and_changes_the_image_by_more(seen):
    top = max(float(image.max()) for image in seen.images())
    level = found_in(seen, lambda image: image + 0.1 * top)["background"]
    image = seen.images()[2]
    assert level.size == pytest.approx(0.1, rel=0.15)
    assert level.consequence == pytest.approx(
        0.1 * top / np.sqrt(np.mean(image[image > 0.05 * top] ** 2)), rel=0.6
    )
    assert "dark={'cam02': " in level.line


@pytest.mark.parametrize("shrink", [1, 2])
def test_a_pose_is_in_pixels_as_recorded_with_an_error(seen, shrink):
    """Neither of the coarse copy that it is found on, nor of images that were shrunk."""
    moved = seen.rig["cam02"].shifted(4.0, -3.0)
    rig = replace(seen.rig, cameras=[moved if c.name == "cam02" else c for c in seen.rig])
    options = tomo.Options(method="mlem", uncertainty=0)
    scan = replace(seen, rig=rig).scaled(shrink)
    (pose,) = tomo.reconstruct(scan, options=options).findings
    assert (pose.effect, pose.camera, pose.unit) == ("pose", "cam02", "px")
    assert pose.size == pytest.approx(5.0, abs=0.4)
    assert 0 < pose.error < 0.5
    assert pose.consequence > 0.1
