"""Exports of photogrammetry and of splatting programs, by their published definitions."""

import json

import cv2
import numpy as np
import pytest
from lens_formulas import TRUTHS, brown, fisheye

from rigs import formats

BROWN = {"k1": -0.12, "k2": 0.05, "p1": 0.001, "p2": -0.002, "k3": 0.03}
RADIAL = {"k1": -0.12, "k2": 0.05}
K4 = {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001}


def vector_of(truth):
    """A camera's turn from the world as a rotation vector, by OpenCV."""
    return cv2.Rodrigues(truth.world_to_camera())[0].ravel().tolist()


def check(assert_projects, rig, lenses):
    """Every camera of a rig projects as its truth does."""
    for camera, truth, lens in zip(rig, TRUTHS, lenses, strict=True):
        assert camera.image_size == truth.size
        assert_projects(camera, lambda points, t=truth, bend=lens: t.pixels(points, bend))


#: OpenSfM's models, with the parameters that each of its cameras has.
OPENSFM = {
    "simple_radial": ({"k1": -0.12}, brown(-0.12)),
    "radial": (RADIAL, brown(**RADIAL)),
    "brown": (BROWN, brown(**BROWN)),
    "fisheye_opencv": (K4, fisheye(*K4.values())),
}


def opensfm(kinds=("simple_radial", "radial", "brown"), **scene):
    """A reconstruction.json: normalised by the longer side, from the middle of the image."""
    cameras, shots = {}, {}
    for i, (truth, kind) in enumerate(zip(TRUTHS, kinds, strict=False)):
        # geometry.rst: pixel = max(w, h) * normalised + ((w - 1) / 2, (h - 1) / 2)
        cameras[f"v2 {i}"] = {
            "projection_type": kind, "width": 640, "height": 480,
            "focal_x": truth.fx / 640, "focal_y": truth.fy / 640,
            "c_x": (truth.cx - 319.5) / 640, "c_y": (truth.cy - 239.5) / 640,
            **OPENSFM[kind][0],
        }  # fmt: skip
        t = (-truth.world_to_camera() @ truth.centre).tolist()
        shots[f"{i}.jpg"] = {"rotation": vector_of(truth), "translation": t, "camera": f"v2 {i}"}
    return [{"cameras": cameras, "shots": shots, "points": {}, **scene}]


@pytest.mark.parametrize("last", ["brown", "fisheye_opencv"])
def test_opensfm(assert_projects, tmp_path, caplog, last):
    path = tmp_path / "reconstruction.json"
    kinds = ("simple_radial", "radial", last)
    scene = opensfm(kinds, reference_lla={"latitude": 47.1, "longitude": 8.2, "altitude": 0})
    path.write_text(json.dumps([*scene, {"cameras": {}, "shots": {}}]))
    assert formats.sniff(path) == "opensfm"
    rig = formats.load(path)
    assert (rig.names, rig.length_unit) == (("0", "1", "2"), "m")
    assert "1 further reconstructions are left out" in caplog.text
    check(assert_projects, rig, [OPENSFM[kind][1] for kind in kinds])


def test_opensfm_with_one_focal_length(assert_projects, tmp_path):
    data = opensfm(("radial", "radial", "radial"))
    for camera, kind in zip(data[0]["cameras"].values(), ("perspective", "fisheye", "fisheye"),
                            strict=True):  # fmt: skip
        for key in ("focal_x", "focal_y", "c_x", "c_y"):
            del camera[key]
        camera |= {"projection_type": kind, "focal": 1.25}
    path = tmp_path / "reconstruction.json"
    path.write_text(json.dumps(data))
    for camera, truth, lens in zip(formats.load(path), TRUTHS, (brown, fisheye, fisheye),
                                   strict=True):  # fmt: skip

        def formula(points, truth=truth, lens=lens):
            return lens(-0.12, 0.05)(truth.plane(points)) * 1.25 * 640 + [319.5, 239.5]

        assert_projects(camera, formula)


ALICEVISION = {
    "pinhole": ([], lambda plane: plane),
    "radial1": ([-0.12], brown(-0.12)),
    "radial3": ([-0.12, 0.05, 0.03], brown(-0.12, 0.05, k3=0.03)),
    # DistortionBrown.cpp: k1 k2 k3 t1 t2, t_x = t2 (r^2 + 2 x^2) + 2 t1 x y
    "brown": ([-0.12, 0.05, 0.03, 0.001, -0.002], brown(**BROWN)),
    "fisheye4": (list(K4.values()), fisheye(*K4.values())),
}
#: Names of the same lenses in `distortionType`, beside the type pinhole.
SINCE_1_2_6 = {"radial1": "radialk1", "radial3": "radialk3", "brown": "brown"}


def text(values):
    return [repr(float(v)) for v in values]


def alicevision(kinds, version=(1, 2, 8), by_distortion=False):
    """A cameras.sfm as boost's property tree writes it: all values are text."""
    views, intrinsics, poses = [], [], []
    for i, (truth, kind) in enumerate(zip(TRUTHS, kinds, strict=True)):
        views.append({"viewId": f"{10 + i}", "poseId": f"{20 + i}", "intrinsicId": f"{30 + i}",
                      "path": f"/data/c{i}.jpg", "width": "640", "height": "480"})  # fmt: skip
        # saveIntrinsic of jsonIO.cpp: mm of the sensor's width; the ratio is fy / fx since 1.2.5
        offset = np.array([truth.cx + 0.5 - 320, truth.cy + 0.5 - 240])
        entry = {"intrinsicId": f"{30 + i}", "width": "640", "height": "480", "type": kind,
                 "distortionParams": text(ALICEVISION[kind][0]) or ""}  # fmt: skip
        if version >= (1, 2, 2):
            ratio = truth.fy / truth.fx if version >= (1, 2, 5) else truth.fx / truth.fy
            entry |= {"sensorWidth": "23.5", "focalLength": repr(truth.fx * 23.5 / 640),
                      "pixelRatio": repr(ratio), "principalPoint": text(offset)}  # fmt: skip
        else:
            entry |= {"pxFocalLength": text([truth.fx, truth.fy]),
                      "principalPoint": text(np.add(offset, (320, 240)))}  # fmt: skip
        if by_distortion and kind in SINCE_1_2_6:
            entry |= {"type": "pinhole", "distortionType": SINCE_1_2_6[kind],
                      "undistortionType": "none"}  # fmt: skip
        intrinsics.append(entry)
        # saveMatrix writes Eigen's storage: column by column of the turn from the world
        rotation = text(truth.world_to_camera().ravel(order="F"))
        transform = {"rotation": rotation, "center": text(truth.centre)}
        poses.append({"poseId": f"{20 + i}", "pose": {"transform": transform, "locked": "0"}})
    return {"version": [str(n) for n in version], "views": views, "intrinsics": intrinsics,
            "poses": poses}  # fmt: skip


@pytest.mark.parametrize(
    ("version", "by_distortion"),
    [((1, 2, 8), False), ((1, 2, 8), True), ((1, 2, 4), False), ((1, 2, 0), False)],
)
@pytest.mark.parametrize(
    "kinds", [("pinhole", "radial1", "radial3"), ("brown", "fisheye4", "brown")]
)
def test_alicevision(assert_projects, tmp_path, kinds, version, by_distortion):
    path = tmp_path / "cameras.sfm"
    path.write_text(json.dumps(alicevision(kinds, version, by_distortion), indent=4))
    assert formats.sniff(path) == "alicevision"
    rig = formats.load(path)
    assert rig.names == ("c0", "c1", "c2")
    check(assert_projects, rig, [ALICEVISION[kind][1] for kind in kinds])


def test_alicevisions_own_example_of_wide_pixels(tmp_path):
    """Numbers of scene_v1.2.8.json of AliceVision's tests, of a camera of 1000 and 2000 px."""
    data = alicevision(("pinhole",) * 3)
    for entry in data["intrinsics"]:
        entry |= {"width": "4092", "height": "2048", "sensorWidth": "36", "pixelRatio": "2",
                  "focalLength": "8.7976539589442808"}  # fmt: skip
        entry["principalPoint"] = ["-26", "16"]
    path = tmp_path / "scene.sfm"
    path.write_text(json.dumps(data))
    K = formats.load(path)[0].camera_matrix
    np.testing.assert_allclose(np.diag(K), (1000, 2000, 1), rtol=1e-12)
    np.testing.assert_allclose(K[:2, 2], (2019.5, 1039.5))


def test_alicevisions_views_without_a_pose_are_named(tmp_path, caplog):
    data = alicevision(("pinhole",) * 3)
    del data["poses"][1]
    path = tmp_path / "cameras.sfm"
    path.write_text(json.dumps(data))
    assert formats.load(path).names == ("c0", "c2")
    assert "left out 1 views without a pose: '/data/c1.jpg'" in caplog.text
    path.write_text(json.dumps({**data, "poses": ""}))
    with pytest.raises(ValueError, match="poses: found a pose of none of 3 views"):
        formats.load(path)


def pix4d():
    """A *_calibrated_camera_parameters.txt, whose head states m = K [R|-Rt] X."""
    lines = ["fileName imageWidth imageHeight", "camera matrix K [3x3]",
             "radial distortion [3x1]", "tangential distortion [2x1]",
             "camera position t [3x1]", "camera rotation R [3x3]",
             "camera model m = K [R|-Rt] X", ""]  # fmt: skip
    for i, truth in enumerate(TRUTHS):
        lines += [f"DSC 0{i}.JPG 640 480", f"{truth.fx} 0 {truth.cx + 0.5}",
                  f"0 {truth.fy} {truth.cy + 0.5}", "0 0 1",
                  f"{BROWN['k1']} {BROWN['k2']} {BROWN['k3']}",
                  f"{BROWN['p1']} {BROWN['p2']}"]  # fmt: skip
        rows = (truth.centre, truth.right, truth.down, truth.forward)
        lines += [" ".join(text(row)) for row in rows]
    return "\n".join(lines) + "\n"


def test_pix4d(assert_projects, tmp_path):
    path = tmp_path / "site_calibrated_camera_parameters.txt"
    path.write_text(pix4d())
    assert formats.sniff(path) == "pix4d"
    rig = formats.load(path)
    assert rig.names == ("DSC 00", "DSC 01", "DSC 02")
    check(assert_projects, rig, [brown(**BROWN)] * 3)


#: heading, pitch and roll in degrees, and the columns of the lens.
CAPTURED = {
    "a.jpg": ((170.3, 85.2, -22.7), {"k1": -0.1, "k2": 0.05, "k3": 0.03, "t1": 1e-3, "t2": -2e-3}),
    "b.jpg": ((-26.5, 40.0, 5.0), {}),
    "c.jpg": ((15.0, 70.0, 100.0), {"k1": -0.12, "k2": 0.05, "k4": 0.02}),
}  # fmt: skip
COLUMNS = "name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"


def realitycapture():
    """A CSV, and the pixels of points in images of 640 x 480 by its numbers."""
    lines, formulas = [f"#{COLUMNS}"], []
    for i, (name, (angles, lens)) in enumerate(CAPTURED.items()):
        values = {"name": name, "x": 10 + i, "y": -20, "alt": 30.5, "f": 31.2 + i, "px": 0.0056,
                  "py": -0.014, "heading": angles[0], "pitch": angles[1], "roll": angles[2],
                  **lens}  # fmt: skip
        lines.append(",".join(str(values.get(column, 0)) for column in COLUMNS.split(",")))
        heading, pitch, roll = np.deg2rad(angles)
        turns = ((0, 0, -heading), (pitch, 0, 0), (0, roll, 0))
        about_z, about_x, about_y = (cv2.Rodrigues(np.array(turn, float))[0] for turn in turns)
        right, up, back = (about_z @ about_x @ about_y).T
        bend = brown(**{k.replace("t", "p"): v for k, v in lens.items()})

        def formula(points, values=values, right=right, up=up, back=back, bend=bend):
            seen = points - [values["x"], values["y"], values["alt"]]
            plane = np.stack([seen @ right, -(seen @ up)], axis=1) / -(seen @ back)[:, None]
            # 36 mm are the longer side; the corner of the image is (0, 0)
            film = bend(plane) * values["f"] / 36 + [values["px"], values["py"]]
            return film * 640 + [320 - 0.5, 240 - 0.5]

        formulas.append(formula)
    return "\n".join(lines) + "\n", formulas


def test_realitycapture(assert_projects, tmp_path):
    content, formulas = realitycapture()
    path = tmp_path / "cameras.csv"
    path.write_text(content)
    assert formats.sniff(path) == "realitycapture"
    with pytest.raises(ValueError, match=r"image a\.jpg: image_size: missing"):
        formats.load(path)
    for name in CAPTURED:
        cv2.imwrite(str(tmp_path / name), np.zeros((480, 640), np.uint8))
    rig = formats.load(path)
    assert rig.names == ("a", "b", "c")
    assert [camera.has_lens_model for camera in rig] == [True, True, False]  # k4: a table of rays
    for camera, formula in zip(rig[:2], formulas, strict=False):
        assert_projects(camera, formula)
    uv = np.random.default_rng(7).integers(0, (640, 480), (200, 2))
    origins, directions = rig["c"].rays(uv.astype(float))
    np.testing.assert_allclose(formulas[2](origins + 300 * directions), uv, rtol=0, atol=1e-6)


SFM = json.dumps(alicevision(("brown",) * 3))
SCENE = json.dumps(opensfm())


@pytest.mark.parametrize(
    ("name", "content", "old", "new", "message"),
    [
        ("r.json", SCENE, '"radial"', '"dual"', "shot 1.jpg: camera v2 1: projection_type: found"),
        ("r.json", SCENE, '"camera": "v2 1"', '"camera": "v3"', "shot 1.jpg: camera: found 'v3'"),
        ("r.json", SCENE, '"translation"', '"moved"', "shot 0.jpg: translation: missing"),
        ("r.json", SCENE, '"shots"', '"shot"', "shots: missing"),
        ("r.json", SCENE, '"projection_type": "brown"', '"projection_type": "radial"',
         "shot 2.jpg: camera v2 2: k3: found 0.03, expected 0 for radial"),
        ("a.sfm", SFM, '"viewId": "10",', '"viewId": "10", "isPoseIndependant": "false",',
         "view 10: isPoseIndependant: found 'false', expected a pose of its own"),
        ("a.sfm", SFM, '"type": "brown",', '"type": "brown", "undistortionParams": ["0.1"],',
         "view 10: intrinsics 30: type: found 'brown', undistorted by ['0.1'], expected one of"),
        ("a.sfm", SFM, '"brown"', '"3deradial4"', "view 10: intrinsics 30: type: found '3derad"),
        ("a.sfm", SFM, '"brown", "distortionParams": ["-0.12", ', '"brown", "distortionParams": [',
         "view 10: intrinsics 30: distortionParams: found 4 numbers, expected 5"),
        ("a.sfm", SFM, '"center": [', '"center": ["far", ', "view 10: pose 20: center: found"),
        ("a.sfm", SFM, '"type": "brown"', '"type": []', "view 10: intrinsics 30: type: found []"),
        ("a.sfm", SFM, '"23.5"', '"0"', "view 10: intrinsics 30: sensorWidth, pixelRatio: found"),
        ("p.txt", pix4d(), "0 0 1\n", "", "image DSC 00.JPG: radial distortion: found"),
        ("p.txt", pix4d() + "a.png 9 7\n", "x", "x", "image a.png: found ['9', '7'], 0 lines"),
        ("p.txt", pix4d(), "640 480", "640 wide", "image DSC 00.JPG: imageWidth, imageHeight: fo"),
        ("c.csv", realitycapture()[0], "170.3", "north", "image a.jpg: heading: found 'north'"),
        ("c.csv", realitycapture()[0], "170.3,", "", "found a line of 15 values, expected 16"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(refused_as, tmp_path, name, content, old, new, message):
    path = tmp_path / name
    assert old in content
    path.write_text(content.replace(old, new))
    size = (640, 480) if name == "c.csv" else None
    refused_as(path, message, path, image_size=size)
