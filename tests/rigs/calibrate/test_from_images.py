"""Calibration from images in memory: what is refused before the search, and what comes back."""

import cv2
import numpy as np
import pytest

from rigs import calibrate_rig
from rigs.calibrate import parse_target

TARGET = "chessboard:7x5:20"
MATRIX = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])


@pytest.fixture(scope="module")
def images():
    """Return images of a chessboard before one camera, the last without it."""
    image, origin = parse_target(TARGET).drawing(2.0)
    to_board = np.array([[0.5, 0, origin[0] + 0.25], [0, 0.5, origin[1] + 0.25], [0, 0, 1]])
    rng, taken = np.random.default_rng(0), {}
    for number in range(6):
        R, _ = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3))
        t = np.array([*rng.uniform(-15, 15, 2), 330.0]) - R @ [60.0, 40.0, 0.0]
        homography = MATRIX @ np.column_stack([R[:, 0], R[:, 1], t]) @ to_board
        seen = cv2.warpPerspective(image, homography, (320, 240), borderValue=255)
        taken[str(number)] = cv2.GaussianBlur(seen, (3, 3), 0)
    return {"cam": taken | {"blank": np.full((240, 320), 255, np.uint8)}}


def test_arrays_become_a_rig_with_notes_on_them(images):
    steps = []
    found = calibrate_rig(
        images, TARGET, distortion="none", progress=lambda *step: steps.append(step)
    )
    np.testing.assert_allclose(found.rig["cam"].camera_matrix, MATRIX, atol=1.5)
    assert "camera cam: target not found in 1 of 7 images: blank" in found.notes
    assert found.images is images
    assert {step.split(":")[1].strip() for _, _, step in steps} == {"detect", "adjust"}
    report = found.report()
    assert report["notes"] == list(found.notes)
    assert report["length_unit"] == "mm"


@pytest.mark.parametrize(
    ("how", "error", "words"),
    [
        ({"model": "none"}, TypeError, "model"),
        ({"distortion": "pinhole"}, ValueError, "distortion: found 'pinhole'"),
        ({"common_lens": [("cam", "other")]}, ValueError, "common_lens: found 'other'"),
        ({"common_lens": "all"}, ValueError, "common_lens: found cam alone"),
        ({"world": "other"}, ValueError, "world: found 'other'"),
        ({"bayer": "RGBG"}, ValueError, "bayer"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_what_is_wrong_is_said_before_the_search(images, how, error, words):
    steps = []
    with pytest.raises(error, match=words):
        calibrate_rig(images, TARGET, progress=lambda *step: steps.append(step), **how)
    assert not steps
