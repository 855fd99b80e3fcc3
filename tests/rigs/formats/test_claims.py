"""Every sample file is claimed by one format alone, and what is no rig by none."""

import json
import re

import cv2
import numpy as np
import pytest

from rigs import Camera, Rig, formats, look_at
from rigs.formats import FORMATS
from rigs.formats._nearest import FIELDS
from rigs.formats._values import read_head

R, T = look_at((30, 10, 200), (0, 0, 0))
K = [[90.0, 0, 32], [0, 90.0, 24], [0, 0, 1]]
POSE = np.vstack([np.column_stack([R, T]), [0, 0, 0, 1]]).tolist()
ONE = Camera("a", (64, 48), K, R=R, t=T, status="calibrated")
P = np.array(K) @ np.array(POSE)[:3]
QUATERNION = "0.8 0.1 0.2 0.3"


def rows(matrix):
    return "".join(" ".join(repr(float(v)) for v in row) + "\n" for row in matrix)


def storage(ending, values):
    """Return what cv2.FileStorage writes."""
    kind = {".yml": cv2.FILE_STORAGE_FORMAT_YAML, ".xml": cv2.FILE_STORAGE_FORMAT_XML,
            ".json": cv2.FILE_STORAGE_FORMAT_JSON}[ending]  # fmt: skip
    file = cv2.FileStorage(f"a{ending}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    for name, value in values.items():
        file.write(name, np.array(value, np.float64) if isinstance(value, list) else value)
    return file.releaseAndGetString()


OPENCV = {"image_width": 64, "image_height": 48, "camera_matrix": K, "R": R.tolist(), "T": [T]}
PAR = "1\nimg/a.1\ncal/a.tif\n1\n0\n1\n64\n48\n0.01\n0.01\n0\n1\n1\n1\n6\n"
ORI = "1 2 300\n0.1 0.2 0.3\n" + "0 " * 9 + "\n0 0 60\n0 0 50\n"
PTV = (
    "num_cams: 1\nptv:\n  imx: 64\n  imy: 48\n  pix_x: 0.01\n  pix_y: 0.01\n  chfield: 0\n"
    "  mmp_n1: 1\n  mmp_n2: 1\n  mmp_n3: 1\n  mmp_d: 6\n  img_cal: [cal/a.tif]\n"
)
KALIBR = (
    "cam0:\n  camera_model: pinhole\n  intrinsics: [90.0, 90.0, 32.0, 24.0]\n"
    "  distortion_model: none\n  distortion_coeffs: []\n  resolution: [64, 48]\n"
)
ANIPOSE = (
    f'[cam_0]\nname = "a"\nsize = [64, 48]\nmatrix = {K}\ndistortions = [0, 0, 0, 0, 0]\n'
    "rotation = [0, 0, 0]\ntranslation = [0, 0, 1]\n"
)
MULTICAL = {
    "cameras": {"a": {"model": "standard", "image_size": [64, 48], "K": K, "dist": [[0] * 5]}},
    "camera_poses": {"a": {"R": np.eye(3).tolist(), "T": [0, 0, 1]}},
}
FRAME = {"file_path": "a.png", "transform_matrix": np.linalg.inv(POSE).tolist()}
SHARED = {"fl_x": 90.0, "w": 64, "h": 48, "cx": 32, "cy": 24}
SPLAT = {"id": 0, "img_name": "a", "width": 64, "height": 48, "position": [0, 0, 1],
         "rotation": R.T.tolist(), "fx": 90.0, "fy": 90.0}  # fmt: skip
METASHAPE = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0"><chunk label="a" enabled='
    '"true"><sensors next_id="1"><sensor id="0" label="a" type="frame"><resolution width="64" '
    'height="48"/></sensor></sensors><cameras><camera id="0" sensor_id="0" label="a"/></cameras>'
    "</chunk></document>\n"
)

ALICEVISION = {
    "version": ["1", "2", "8"], "views": [{"viewId": "1", "poseId": "1", "intrinsicId": "2"}],
    "intrinsics": [{"intrinsicId": "2"}], "poses": [],
}  # fmt: skip
OPENSFM = {"cameras": {"a": {"projection_type": "brown"}},
           "shots": {"a.png": {"rotation": [], "translation": []}}}  # fmt: skip
QUALISYS = (
    '<calibration><cameras><camera serial="1"><fov_video left="0"/><transform x="1"/>'
    '<intrinsic focalLengthU="9"/></camera></cameras></calibration>\n'
)
PIX4D = (
    "fileName imageWidth imageHeight\ncamera matrix K [3x3]\nradial distortion [3x1]\n"
    "camera model m = K [R|-Rt] X\n\na.png 64 48\n"
)

#: For each format, sets of files; the first of a set is the one that is read, and its folder too
#: where the format has folders.
SAMPLES = {
    "emission_rig": [{"rig.yaml": "format: emission-rig\nversion: 1\ncameras: []\n"}],
    "middlebury": [{"a_par.txt": f"1\na.png {' '.join(rows([*K, *R, T]).split())}\n"}],
    "colmap": [
        {"cameras.txt": "1 PINHOLE 64 48 90 90 32 24\n",
         "images.txt": f"1 {QUATERNION} 0 0 9 1 a.png\n\n", "points3D.txt": "1 0 0 0 9 9 9 0.1\n"},
        {"cameras.bin": "\0" * 8, "images.bin": "\0" * 8, "points3D.bin": "\0" * 8},
    ],
    "transforms": [{"transforms.json": json.dumps({**SHARED, "frames": [FRAME]})},
                   {"train.json": json.dumps({**SHARED, "frames": [FRAME]})}],
    "multical": [{"calibration.json": json.dumps(MULTICAL)}],
    "kalibr": [{"camchain.yaml": KALIBR}],
    "anipose": [{"calibration.toml": ANIPOSE}],
    "openptv": [
        {"parameters/ptv.par": PAR, "cal/a.tif.ori": ORI, "cal/a.tif.addpar": "0 0 0 0 0 1 0"},
        {"cal/a.tif.ori": ORI, "cal/a.tif.addpar": "0 0 0 0 0 1 0", "parameters/ptv.par": PAR},
        {"parameters_Run1.yaml": PTV, "cal/a.tif.ori": ORI},
    ],
    "opencv": [{f"a{ending}": storage(ending, OPENCV)} for ending in (".yml", ".json", ".xml")],
    "myptv": [{"cam1": "Tsai model camera\ncam1\n64 48\n1 2 500\n0.1 0.2 0.3\n900\n1 -1\n"
               + "0 0 0 0 0\n" * 3}],
    "bundler": [{"bundle.out": "# Bundle file v0.3\n1 0\n90 0 0\n" + rows([*R, T]),
                 "list.txt": "a.png\n"}],
    "projection": [{"txt/a.txt": rows(P)}, {"txt/a.txt": "CONTOUR\n" + rows(P)}],
    "dlt": [{"a_DLTcoefs.csv": "".join(f"{v},{v}\n" for v in (P / P[2, 3]).ravel()[:11])}],
    "easymocap": [{"intri.yml": storage(".yml", {"K_1": K, "dist_1": [[0.0] * 5]}),
                   "extri.yml": storage(".yml", {"R_1": [[0.0]] * 3, "T_1": [[9.0]] * 3})}],
    "mrcal": [{"a.cameramodel": "{\n    'lensmodel': 'LENSMODEL_PINHOLE',\n    'extrinsics': "
               "[0, 0, 0, 0, 0, 1],\n    'intrinsics': [90, 90, 32, 24],\n"
               "    'imagersize': [64, 48]\n}\n"}],
    "metashape": [{"cameras.xml": METASHAPE}],
    "gaussian_splatting": [{"cameras.json": json.dumps([SPLAT])}],
    "alicevision": [{"cameras.sfm": json.dumps(ALICEVISION)}],
    "opensfm": [{"reconstruction.json": json.dumps([OPENSFM])}],
    "qualisys": [{"a.qca.txt": QUALISYS}],
    "kitti": [{"calib_cam_to_cam.txt": "".join(f"{key}_00: 1 2 3\n" for key in "SKDRT")},
              {"calib.txt": "".join(f"P{i}: {' '.join(rows(P).split())}\n" for i in range(4))}],
    "camera_table": [{"a.csv": "name,x,y,z,look_x,look_y,look_z,focal_mm,pitch_um\n"},
                     {"a.tsv": "camera\tx [mm]\ty [mm]\tz [mm]\n"}],
    "realitycapture": [{"a.csv": "#name,x,y,alt,heading,pitch,roll,f\na.png,1,2,3,4,5,6,20\n"}],
    "pix4d": [{"a_calibrated_camera_parameters.txt": PIX4D}],
}  # fmt: skip
#: Formats whose folder is a rig too: the folder of the sample's first file.
FOLDERS = (
    "colmap",
    "openptv",
    "opencv",
    "myptv",
    "projection",
    "easymocap",
    "mrcal",
)
BY_NAME = ("dlt_matlab", "dlt_bottom")  # no file says that it is one of these
WITHOUT_XML = pytest.mark.skipif("metashape" not in FORMATS, reason="no XML is read")

CASES = [
    pytest.param(name, files, id=f"{name} {next(iter(files))}",
                 marks=[WITHOUT_XML] if next(iter(files)).endswith(".xml") else [])
    for name, sets in SAMPLES.items() if name in FORMATS
    for files in sets
]  # fmt: skip


def claiming(path):
    """The formats that take a path for theirs."""
    head = read_head(path) if path.is_file() else ""
    return [name for name in formats.names() if FORMATS[name].module.looks_like(path, head)]


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / next(iter(files))


def test_every_format_has_a_sample():
    assert set(formats.names()) == {name for name in SAMPLES if name in FORMATS} | set(BY_NAME)


@pytest.mark.parametrize(("name", "files"), CASES)
def test_a_sample_is_claimed_by_its_format_alone(tmp_path, name, files):
    path = write(tmp_path, files)
    assert claiming(path) == [name]
    assert formats.sniff(path) == name
    if name in FOLDERS:
        assert claiming(path.parent) == [name]


@pytest.mark.parametrize("name", FIELDS)
def test_a_sample_has_the_fields_of_its_format(name):
    """The message about an unknown file says which format lacks fewest of them."""
    text = "".join(next(iter(SAMPLES[name][0].values())))
    assert set(FIELDS[name].split()) <= set(re.findall(r"\w+", text))


@pytest.mark.parametrize("name", ["rtk", "astra"])
def test_formats_that_are_only_written_are_claimed_by_none(tmp_path, name):
    file = tmp_path / f"a{FORMATS[name].suffixes[0]}"
    ring = [look_at((200 * np.sin(a), 0, 200 * np.cos(a)), (0, 0, 0)) for a in (0.0, 1.0)]
    middle = [[90.0, 0, 31.5], [0, 90.0, 23.5], [0, 0, 1]]
    cameras = (Camera(f"c{i}", (64, 48), middle, R=R, t=t) for i, (R, t) in enumerate(ring))
    formats.save(Rig(tuple(cameras)), file, name)
    assert claiming(file) == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", "1 2 3\n4 5 6\n"),
        ("points.csv", rows(np.ones((12, 3)))),
        ("poses.txt", rows(np.ones((4, 12)))),
        ("a.json", '{"a": [1, 2, 3]}'),
        ("a.yaml", "a: 1\n"),
        ("a.xml", "<a/>\n"),
        ("a.toml", "[a]\nb = 1\n"),
        ("points3D.txt", "1 0 0 0 255 255 255 0.1\n"),
        ("README.md", "# A scan\n"),
        ("empty.txt", ""),
    ],
)
def test_other_files_are_claimed_by_none(tmp_path, name, text):
    path = write(tmp_path, {name: text})
    assert claiming(path) == []
    assert claiming(tmp_path) == []
