"""Every sample file is claimed by one format alone, and what is no rig by none."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rigs import Camera, Rig, formats, look_at
from rigs.formats import FORMATS
from rigs.formats._values import read_head

SAMPLES = yaml.safe_load((Path(__file__).parent / "samples.yaml").read_text("utf-8"))
SAMPLES["colmap"].append({f"{name}.bin": "\0" * 8 for name in ("cameras", "images", "points3D")})
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
CASES = [
    pytest.param(name, files, id=f"{name} {next(iter(files))}")
    for name, sets in SAMPLES.items()
    for files in sets
]


def claiming(path):
    """The formats that take a path for theirs."""
    head = read_head(path) if path.is_file() else ""
    return [name for name in formats.names() if FORMATS[name].looks_like(path, head)]


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / next(iter(files))


def test_every_format_has_a_sample():
    assert set(formats.names()) == set(SAMPLES) | set(BY_NAME)


@pytest.mark.parametrize(("name", "files"), CASES)
def test_a_sample_is_claimed_by_its_format_alone(tmp_path, name, files):
    path = write(tmp_path, files)
    assert claiming(path) == [name]
    assert formats.sniff(path) == name
    if name in FOLDERS:
        assert claiming(path.parent) == [name]


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.words])
def test_a_sample_has_the_fields_of_its_format(name):
    """The message about an unknown file says which format lacks fewest of them."""
    text = "".join(next(iter(SAMPLES[name][0].values())))
    assert set(FORMATS[name].words.split()) <= set(re.findall(r"\w+", text))


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
        ("points.csv", "1 2 3\n" * 12),
        ("poses.txt", "1 2 3 4 5 6 7 8 9 10 11 12\n" * 4),
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
