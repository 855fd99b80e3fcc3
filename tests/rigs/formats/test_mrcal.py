"""mrcal's camera models, written here as its own ``.cameramodel`` files are."""

import cv2
import numpy as np
import pytest
from lens_formulas import COEFFICIENTS

from rigs import formats

LENSES = {
    "PINHOLE": (),
    "OPENCV4": COEFFICIENTS["brown"][:4],
    "OPENCV5": COEFFICIENTS["brown"],
    "OPENCV8": COEFFICIENTS["rational"],
    "OPENCV12": COEFFICIENTS["thin_prism"],
}
EXTRINSICS = [0.3, -0.2, 1.1, 12.0, -7.0, 150.0]


def text_of(model, coefficients, key="lensmodel"):
    intrinsics = [812.5, 807.25, 321.3, 238.4, *coefficients]
    return f"""# generated on 2026-01-01 with   mrcal-calibrate-cameras
{{
    '{key}':  '{model}',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': {intrinsics},

    'valid_intrinsics_region': [
    [ 10, 10 ],
    [ 10, 400 ],
    ],

    # extrinsics are rt_cam_ref
    'extrinsics': {EXTRINSICS},

    'imagersize': [ 640,480 ],

    'icam_intrinsics': 0,
    'optimization_inputs': b'P)h>@6aWAK2mtey-
7*qF',
}}
""".replace("-\n7*", "-7*")


@pytest.mark.parametrize("key", ["lensmodel", "lens_model"])
@pytest.mark.parametrize("lens", LENSES)
def test_the_opencv_models(assert_projects, tmp_path, lens, key):
    path = tmp_path / "left.cameramodel"
    path.write_text(text_of(f"LENSMODEL_{lens}", LENSES[lens], key))
    assert formats.sniff(path) == "mrcal"
    (camera,) = formats.load(path)
    assert (camera.name, camera.image_size) == ("left", (640, 480))

    def by_opencv(points):
        K = np.array([[812.5, 0, 321.3], [0, 807.25, 238.4], [0, 0, 1]])
        rvec, t = np.array(EXTRINSICS[:3]), np.array(EXTRINSICS[3:])
        return cv2.projectPoints(points, rvec, t, K, np.array(LENSES[lens], float))[0][:, 0]

    assert_projects(camera, by_opencv)


def test_a_folder_is_a_rig(tmp_path):
    for name in ("b", "a"):
        (tmp_path / f"{name}.cameramodel").write_text(text_of("LENSMODEL_PINHOLE", ()))
    assert formats.sniff(tmp_path) == "mrcal"
    assert formats.load(tmp_path).names == ("a", "b")


def test_models_of_older_files(tmp_path):
    (tmp_path / "a.cameramodel").write_text(text_of("DISTORTION_NONE", (), "distortion_model"))
    assert formats.load(tmp_path)[0].distortion.model == "none"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("OPENCV5", "CAHVOR", "lensmodel: found 'LENSMODEL_CAHVOR', expected one of LENSMODEL_PI"),
        ("OPENCV5", "SPLINED_STEREOGRAPHIC_order=3", "lensmodel: found 'LENSMODEL_SPLINED"),
        ("OPENCV5", "OPENCV8", "intrinsics: found [812.5, "),
        ("'extrinsics'", "'poses'", "extrinsics: missing"),
        ("640,480", "640,0", "imagersize: found 0.0, expected a whole number"),
        ("[ 640", "[ __import__('os').getcwd()", "broken camera model"),
        ("'imagersize': [", "'imagersize': [[", "broken camera model at line"),
        (
            "'imagersize'",
            "'imagersize': " + "[" * 500 + "]" * 500 + ", 'b'",
            "broken camera model",
        ),
    ],
)
def test_what_is_wrong_is_named(refused_as, tmp_path, old, new, message):
    path = tmp_path / "a.cameramodel"
    text = text_of("LENSMODEL_OPENCV5", LENSES["OPENCV5"])
    assert old in text
    path.write_text(text.replace(old, new))
    refused_as(f"{path}: camera a", message, path)
