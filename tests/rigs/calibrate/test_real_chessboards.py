"""The chessboard pairs of OpenCV's samples."""

import cv2
import numpy as np
import pytest

from rigs.calibrate import Observations, calibrate
from rigs.calibrate.detect import detections, image_set, observe
from rigs.calibrate.targets import parse_target


@pytest.fixture(scope="module")
def images(test_data):
    return image_set(test_data / "chessboard_stereo")


@pytest.fixture(scope="module")
def found(images):
    return detections(images, parse_target("chessboard:9x6:1.0"))


def test_every_corner_of_every_board_is_found(found):
    assert (found.observations.counts() == 54).all()
    assert found.observations.cameras == ("left", "right")
    assert len(found.observations.frames) == 13
    assert found.observations.image_sizes == ((640, 480), (640, 480))
    assert not found.reasons
    assert not found.blurred()


@pytest.mark.parametrize(("camera", "most"), [("left", 0.16), ("right", 0.16)])
def test_corners_fit_a_camera_much_better_than_opencvs(found, camera, most):
    """With findChessboardCorners and cornerSubPix it is 0.409 px left and 0.459 px right."""
    seen = found.observations
    own = seen.camera == seen.cameras.index(camera)
    uv = [seen.uv[own & (seen.frame == k)].astype(np.float32) for k in range(13)]
    points = [seen.target_points.astype(np.float32)] * 13
    assert cv2.calibrateCamera(points, uv, (640, 480), None, None)[0] < most


@pytest.mark.parametrize("size", ["8x6", "9x7"])
def test_a_wrong_number_of_squares_is_reported_with_the_right_one(images, size):
    some = {"left": {name: images["left"][name] for name in list(images["left"])[:3]}}
    with pytest.raises(
        ValueError, match=r"camera left: .*found a chessboard of 9x6 inner"
    ) as error:
        observe(some, parse_target(f"chessboard:{size}:1.0"))
    assert f"expected chessboard:{size}:1.0" in str(error.value)


def test_pairs_are_calibrated_as_well_as_by_opencv(test_data, one_camera):
    """13 pairs: at least as good as OpenCV's joint solution, with no corner thrown away."""
    folder = test_data / "chessboard_stereo"
    if not folder.is_dir():
        pytest.skip(f"no images at {folder}")
    grid = np.mgrid[:6, :9].reshape(2, -1).T
    points = np.c_[grid[:, ::-1], np.zeros(54)]
    rows, pixels = [], []
    for camera, side in enumerate(("left", "right")):
        for frame, path in enumerate(sorted((folder / side).glob("*.jpg"))):
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            ok, corners = cv2.findChessboardCorners(image, (9, 6))
            assert ok
            end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
            corners = cv2.cornerSubPix(image, corners, (11, 11), (-1, -1), end)
            rows += [(camera, frame, point) for point in range(54)]
            pixels.append(corners.reshape(-1, 2))
    camera, frame, point = np.transpose(rows)
    frames = tuple(f"{number:02d}" for number in range(13))
    observations = Observations(
        points, ("left", "right"), ((640, 480),) * 2, frames, camera, frame, point,
        np.concatenate(pixels),
    )  # fmt: skip

    def rms(calibration):
        assert calibration.used.all()
        return np.sqrt((calibration.residuals**2).sum(axis=1).mean())

    for camera, limit in ((0, 0.409), (1, 0.459)):
        alone = calibrate(one_camera(observations, camera), distortion="brown5", cull=False)
        assert rms(alone) <= limit
    joint = calibrate(observations, distortion="brown5", cull=False)
    assert rms(joint) <= 0.445
    baseline = np.linalg.norm(joint.rig["left"].position - joint.rig["right"].position)
    assert baseline == pytest.approx(3.338, abs=0.01)
