"""A full ring in which no target is seen by all cameras, of the size that is promised."""

from rigs import ray_miss
from rigs.calibrate import calibrate


def test_a_ring_of_twelve_where_neighbours_alone_share_views(simulated_rig, judged_volume):
    truth = simulated_rig("ring", cameras=12, frames=36, seed=8)
    observations = truth.observe(0.03, seed=3, facing=0.6)
    seen = observations.counts() > 0
    assert seen.sum(axis=0).max() <= 4
    found = calibrate(observations, distortion="brown4")
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 0.005
    assert found.assessment.startswith("good")
    assert found.used.all()
