import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from rigs import load_rig
from rigs.recordings import write_image
from tomo import load_scan

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


def blocks(language):
    return re.findall(rf"^[ ]*```{language}\n(.*?)^[ ]*```", README, re.DOTALL | re.MULTILINE)


def test_python_example_runs_and_reconstructs_well(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("python")
    assert len([line for line in example.splitlines() if line and "import" not in line]) <= 15
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["outcome"].report()["quality"]["cosine_distance"] < 0.02
    assert names["volume"].shape == (24, 40, 24)


def test_yaml_examples_are_a_rig_and_a_scan_of_it(tmp_path):
    for name, example in zip(("rig.yaml", "scan.yaml"), blocks("yaml"), strict=True):
        (tmp_path / name).write_text(textwrap.dedent(example), "utf-8")
    camera = load_rig(tmp_path / "rig.yaml")["left"]
    assert camera.position == pytest.approx([-300, 0, 500])

    (tmp_path / "raw").mkdir()
    width, height = camera.image_size
    raw = np.full((height, width), 2000, np.uint16)
    dark, mask = np.full_like(raw, 100), np.full_like(raw, 255, dtype=np.uint8)
    mask[0, 0] = 0
    write_image(tmp_path / "raw/left_0001.tif", raw)
    write_image(tmp_path / "dark.tif", dark)
    write_image(tmp_path / "left_mask.png", mask)
    (image,), (usable,) = load_scan(tmp_path).read("0001")
    assert image[1, 1] == pytest.approx(1.02 * 1900 / 4095)
    assert not usable[0, 0]


@pytest.mark.parametrize("target", re.findall(r"\]\(([\w/.]+)\)", README))
def test_links_lead_to_files(target):
    assert (Path(__file__).parents[1] / target).is_file()
