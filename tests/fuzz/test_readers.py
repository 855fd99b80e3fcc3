"""Damaged files: every reader reads them or refuses them in one line, and does nothing else.

100 files a reader by default, 10,000 with ``--hypothesis-profile=long``, see tests/conftest.py.
"""

import contextlib
import logging
import warnings

import pytest
from hypothesis import given, settings
from mutations import damaged
from samples import readers

from rigs.formats import _image_size

NAMES = (
    *("rig.yaml", "ray table", "Middlebury", "COLMAP cameras.txt", "COLMAP images.txt"),
    *("COLMAP rigs.txt", "transforms.json", "multical", "Kalibr", "anipose"),
    *("OpenPTV parameters/ptv.par", "OpenPTV cal/cam1.tif.ori", "OpenCV YAML", "OpenCV JSON"),
    *("OpenCV stereo", "MyPTV", "format unknown .json", "format unknown .toml"),
    *("format unknown .yaml", "format unknown .txt", "COLMAP cameras.bin", "COLMAP images.bin"),
    *("COLMAP rigs.bin", "COLMAP lenses", "Bundler", "Bundler list"),
    *("projection", "DLT", "DLT bottom", "pyptv", "EasyMocap", "OpenCV XML"),
    *("OpenCV lists", "mrcal", "Metashape", "Gaussian splatting"),
    *("format unknown .xml", "format unknown of tools", "AliceVision", "OpenSfM"),
    *("Qualisys", "KITTI", "KITTI rectified", "Pix4D"),
    *("RealityCapture", "scan.yaml", "scan of transforms.json"),
    *("world file", "volume .npz", "volume .vti", "volume .nrrd", "volume .npy", "volume .mha"),
    *("volume .nii", "volume .nii.gz", "image .tif", "image .png", "image .jpg", "image .pgm"),
    *("notes on images", "calibration image", "detection cache", "film .tif", "film .avi"),
    *("film .avi by OpenCV", "film .cine", "film .mraw", "film .cihx", "film .cih", "film .im7"),
    *("film .h5", "film .npy", "film zarr.json", "film chunk", "encoder", "checkpoint"),
)


@pytest.fixture(scope="module")
def every_reader(tmp_path_factory):
    return readers(tmp_path_factory.mktemp("samples"))


@pytest.fixture(scope="module", autouse=True)
def quiet():
    """Tables of rays take memory by the camera's pixels, and libraries log what they dislike."""
    logging.disable()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_image_size, "MOST_RAYS", 1 << 14)
        yield
    logging.disable(logging.NOTSET)


def test_every_reader_is_tried(every_reader):
    assert tuple(every_reader) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_damaged_files_are_read_or_refused_in_one_line(
    every_reader, read_or_refused, tmp_path_factory, monkeypatch, name
):
    reader = every_reader[name]
    folder = tmp_path_factory.mktemp("files")
    monkeypatch.chdir(folder)  # where code in a file would write
    path = folder / reader.file
    for other, content in {**reader.others, reader.file: b""}.items():
        (folder / other).parent.mkdir(parents=True, exist_ok=True)
        (folder / other).write_bytes(content)
    for sample in reader.samples:  # what reading imports takes memory too
        path.write_bytes(sample)
        with contextlib.suppress(ValueError), warnings.catch_warnings(action="ignore"):
            reader.read(path)

    @settings(max_examples=2 * settings.default.max_examples)
    @given(damaged(reader.samples, reader.changes))
    def check(content):
        path.write_bytes(content)
        with warnings.catch_warnings(action="ignore"):
            read_or_refused(reader.read, path, folder)

    check()
