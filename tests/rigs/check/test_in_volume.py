"""The check of a rig in voxels: its own, or those of a grid."""

import json

import numpy as np
import pytest

from rigs import Rig, Volume, check_rig, ring
from rigs.check.rig_check import MOST_POINTS, centers_of, lattice

BOX = Volume((12, 20, 8), (1.0, 0.5, 2.0), (1.0, 2.0, 3.0))
RIG = ring(8, distance=200.0, image_size=(60, 60), footprint=0.6, center=BOX.center, volume=BOX)


def test_points_reach_from_the_first_voxel_to_the_last():
    large = Volume((120, 200, 80), (0.1, 0.05, 0.2), (1.0, 2.0, 3.0))
    for box in (BOX, large):
        points = centers_of(lattice(box))
        half = (np.array(box.shape) - 1) * box.spacing / 2
        np.testing.assert_allclose(points.min(axis=0), np.subtract(box.center, half))
        np.testing.assert_allclose(points.max(axis=0), np.add(box.center, half))
        assert len(points) <= MOST_POINTS


def test_a_rig_is_checked_in_its_own_volume_unless_another_is_named():
    own, other = check_rig(RIG), check_rig(RIG, Volume((4, 4, 4), 1.0, BOX.center))
    assert own.volume == BOX
    assert own.weights.sum() == pytest.approx(1)
    assert own.voxel == pytest.approx(1.0)
    assert other.voxel == pytest.approx(1.0)
    assert len(other.coverage.points) == 27  # an odd number along each edge
    with pytest.raises(ValueError, match="volume: found none, expected voxels"):
        check_rig(Rig(RIG.cameras))
    with pytest.raises(ValueError, match="cameras: found none"):
        check_rig(Rig((), volume=BOX))


def test_its_report_is_plain_data():
    report = json.loads(json.dumps(check_rig(RIG).report(), allow_nan=False))
    assert report["assessment"] in ("good", "limited", "not usable")
    assert list(report["cameras"]) == list(RIG.names)
    assert report["views"]["most"] == 8
