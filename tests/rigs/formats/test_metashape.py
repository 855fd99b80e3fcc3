"""Metashape's XML, written here by the layout of its exports and the formulas of its manual."""

import re

import numpy as np
import pytest

from rigs import RayTable, formats, look_at

FRAME = {"f": 803.5, "cx": -3.2, "cy": 2.7, "b1": 9.5, "b2": -0.8, "k1": -0.12, "k2": 0.05,
         "k3": 0.01, "p1": -0.002, "p2": 0.001}  # fmt: skip
FISHEYE = {"f": 330.0, "cx": 2.1, "cy": -1.5, "k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.001}
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
SCALE, SHIFT = 2.5, np.array([3.0, -2.0, 7.0])
WORLD = (
    f"<transform><rotation locked='true'>{' '.join(map(repr, TURN.ravel().tolist()))}</rotation>"
    f"<translation>{' '.join(map(repr, SHIFT.tolist()))}</translation><scale>{SCALE}</scale>"
    "</transform>"
)
METRES = '<reference>LOCAL_CS["Local (m)",UNIT["metre",1,AUTHORITY["EPSG","9001"]]]</reference>'


def poses():
    """Camera-to-chunk matrices of three cameras."""
    found = []
    for position in ((10, 40, 300), (260, 30, 150), (-250, 60, 170)):
        R, _ = look_at(position, (0, 0, 0))
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = R.T, position
        found.append(motion)
    return found


def document(sensors=(("frame", FRAME),), extra="", in_component="", more_cameras="", labels=None):
    labels = labels or ["c0", "c1.JPG", "c2"]
    text = ""
    for index, (kind, values) in enumerate(sensors):
        numbers = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
        text += (
            f'<sensor id="{index}" label="s" type="{kind}"><resolution width="640" height="480"/>'
            '<property name="layer_index" value="0"/>'
            f'<calibration type="{kind}" class="initial"><f>1</f></calibration>'
            f'<calibration type="{kind}" class="adjusted"><resolution width="640" height="480"/>'
            f"{numbers}</calibration></sensor>\n"
        )
    component = ' component_id="0"' if in_component else ""
    cameras = ""
    for index, (label, motion) in enumerate(zip(labels, poses(), strict=False)):
        sensor = min(index, len(sensors) - 1)
        cameras += (
            f'<camera id="{index}" sensor_id="{sensor}"{component} label="{label}"><transform>'
            f"{' '.join(map(repr, motion.ravel().tolist()))}</transform>"
            "<orientation>1</orientation></camera>\n"
        )
        if index == 0:
            cameras = f'<group id="0" label="ring" type="folder">{cameras}</group>'
    if in_component:
        in_component = (
            '<components next_id="1" active_id="0"><component id="0" label="Component 1">'
            f"{in_component}</component></components>"
        )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n'
        '<chunk label="Chunk 1" enabled="true">\n'
        f'<sensors next_id="1">{text}</sensors>{in_component}<cameras next_id="3">{cameras}'
        f"{more_cameras}</cameras>{extra}</chunk></document>\n"
    )


def pixels(points, motion, kind, v, scale=1.0, turn=None, shift=0.0):
    """Pixels, top-left centre at (0.5, 0.5), of points in the world, as the manual has it."""
    in_chunk = (points - shift) @ (np.eye(3) if turn is None else turn) / scale
    X, Y, Z = ((in_chunk - motion[:3, 3]) @ motion[:3, :3]).T
    x, y = X / Z, Y / Z
    if kind == "fisheye":
        r0 = np.sqrt(x * x + y * y)
        x, y = x * np.arctan(r0) / r0, y * np.arctan(r0) / r0
    k1, k2, k3, k4, p1, p2, b1, b2 = (
        v.get(k, 0.0) for k in ("k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2")
    )
    q = x * x + y * y
    gain = 1 + k1 * q + k2 * q**2 + k3 * q**3 + k4 * q**4
    more = 1 + v.get("p3", 0.0) * q + v.get("p4", 0.0) * q**2
    x, y = (
        x * gain + (p1 * (q + 2 * x * x) + 2 * p2 * x * y) * more,
        y * gain + (p2 * (q + 2 * y * y) + 2 * p1 * x * y) * more,
    )
    u = 640 * 0.5 + v["cx"] + x * v["f"] + x * b1 + y * b2
    return np.stack([u, 480 * 0.5 + v["cy"] + y * v["f"]], axis=1)


def write(folder, text):
    path = folder / "cameras.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("places", "unit"),
    [
        ({}, "unit"),
        ({"extra": WORLD}, "unit"),
        ({"extra": WORLD + METRES}, "m"),
        ({"in_component": WORLD, "extra": "<reference>GEOGCS[...]</reference>"}, "m"),
    ],
)
def test_frames_and_fisheyes(assert_projects, tmp_path, places, unit):
    sensors = (("frame", FRAME), ("fisheye", FISHEYE), ("frame", {"f": 700.0, "cx": 0, "cy": 0}))
    path = write(tmp_path, document(sensors, **places))
    assert formats.sniff(path) == "metashape"
    rig = formats.load(path)
    assert rig.names == ("c0", "c1", "c2")
    assert rig.length_unit == unit
    world = (SCALE, TURN, SHIFT) if places else (1.0, np.eye(3), np.zeros(3))
    for camera, motion, (kind, values) in zip(rig, poses(), sensors, strict=True):

        def by_manual(points, motion=motion, kind=kind, values=values):
            return pixels(points, motion, kind, values, *world) - 0.5

        assert_projects(camera, by_manual)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("frame", {**FRAME, "k4": 0.2}),
        ("frame", {**FRAME, "p1": -0.01, "p3": 0.4, "p4": -0.3}),
        ("frame", {**FRAME, "f": 350.0, "k1": -0.3, "k2": 0.1, "k3": 0, "k4": -0.05}),  # folds
        ("fisheye", {**FISHEYE, "p1": -0.003, "p2": 0.002}),
    ],
)
def test_lenses_without_a_model_are_tables_of_rays(tmp_path, kind, values):
    text = document(((kind, values),), extra=WORLD, labels=["c0"])
    (camera,) = formats.load(write(tmp_path, text))
    assert isinstance(camera, RayTable)
    uv = np.stack([a.ravel() for a in np.meshgrid(np.arange(640), np.arange(480))], axis=1)
    origins, directions = camera.rays()
    seen = np.flatnonzero(np.isfinite(directions[:, 0]))
    assert len(seen) > 200_000
    some = np.random.default_rng(0).choice(seen, 200)
    points = origins[some] + 300 * directions[some]
    found = pixels(points, poses()[0], kind, values, SCALE, TURN, SHIFT) - 0.5
    np.testing.assert_allclose(found, uv[some], rtol=0, atol=1e-6)


def test_what_metashape_did_not_align_is_named(tmp_path, caplog):
    more = (
        '<camera id="8" sensor_id="0" label="IMG_8.JPG"/><camera id="9" sensor_id="0" enabled="0" '
        'label="IMG_9.JPG"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>'
    )
    assert len(formats.load(write(tmp_path, document(more_cameras=more)))) == 3
    assert "left out 2 cameras" in caplog.text
    assert "IMG_8.JPG, IMG_9.JPG" in caplog.text


def test_slaves_without_a_pose_are_refused(tmp_path):
    more = '<camera id="8" sensor_id="0" master_id="0" label="IMG_8.JPG"/>'
    with pytest.raises(
        ValueError, match=r"camera IMG_8\.JPG: transform: missing, as of a slave of"
    ):
        formats.load(write(tmp_path, document(more_cameras=more)))


def test_labels_with_folders_name_cameras(tmp_path):
    labels = [r"D:\shots\left\001.tif", r"D:\shots\right\001.tif"]
    assert formats.load(write(tmp_path, document(labels=labels))).names == ("left", "right")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="frame"', 'type="spherical"', "camera c0: sensor 0: type: found 'spherical', exp"),
        ("<k3>0.01</k3>", "<k4>inf</k4>", "camera c0: sensor 0: k4: found 'inf', expected a fin"),
        ("<f>803.5</f>", "", "camera c0: sensor 0: f: missing"),
        ("<f>803.5</f>", "<f>wide</f>", "camera c0: sensor 0: f: found 'wide'"),
        ('sensor_id="0"', 'sensor_id="5"', "camera c0: sensor_id: found 5, expected one of"),
        ("<transform>", "<transform>7 ", "camera c0: transform: found"),
        ("<transform>", "<moved>", "broken XML: mismatched tag"),
        ("<?xml version", "<!DOCTYPE a [<!ENTITY b 'b'>]><?xml version", "found an XML entity"),
        ("<group ", "<a>" * 40 + "<group ", "broken XML: nested too deeply"),
    ],
)
def test_what_is_wrong_is_named(refused_as, tmp_path, old, new, message):
    assert old in document()
    path = write(tmp_path, document().replace(old, new))
    refused_as(path, message, path, "metashape")


def test_a_chunk_without_poses_is_refused(tmp_path):
    text = re.sub("<transform>.*?</transform>", "", document())
    with pytest.raises(ValueError, match="found none with a transform among 3, expected aligned"):
        formats.load(write(tmp_path, text))
