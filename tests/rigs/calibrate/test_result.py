import numpy as np

from rigs.calibrate import calibrate


def test_target_poses_are_where_the_target_was_seen_from_the_held_camera(simulated_rig):
    simulated = simulated_rig(cameras=3, frames=6)
    found = calibrate(simulated.observe(0.03, seed=4), distortion="brown4")
    poses = found.rig.calibration["target_poses"]
    assert [pose["frame"] for pose in poses] == list(found.observations.frames)
    points = simulated.points
    (left, top), (right, bottom) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    border = np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])
    for index, pose in enumerate(poses):
        camera = simulated.rig[pose["camera"]]
        truth = border @ simulated.target_R[index].T + simulated.target_t[index]
        wanted, _, _ = camera.project(truth)
        own = np.array(pose["corners"]) @ found.rig[pose["camera"]].R
        own = own + found.rig[pose["camera"]].position
        seen, _, _ = found.rig[pose["camera"]].project(own)
        np.testing.assert_allclose(seen, wanted, atol=0.3)  # pixels, at the target's corners
