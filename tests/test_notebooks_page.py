"""The page "From Python": each block is short, and all run in their order."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigs.calibrate import parse_target
from rigs.recordings import write_image

PAGE = Path(__file__).parents[1] / "docs/guide/notebooks.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)


def photograph(folder, count=6):
    """Write images of the page's chessboard, held in several poses before one camera."""
    image, origin = parse_target("chessboard:7x5:20").drawing(2.0)
    K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
    to_board = np.array([[0.5, 0, origin[0] + 0.25], [0, 0.5, origin[1] + 0.25], [0, 0, 1]])
    rng = np.random.default_rng(0)
    for number in range(count):
        R, _ = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3))
        middle = np.array([60.0, 40.0, 0.0])
        t = np.array([rng.uniform(-20, 20), rng.uniform(-15, 15), 330.0]) - R @ middle
        homography = K @ np.column_stack([R[:, 0], R[:, 1], t]) @ to_board
        seen = cv2.warpPerspective(image, homography, (320, 240), borderValue=255)
        write_image(folder / "cam00" / f"{number}.png", cv2.GaussianBlur(seen, (3, 3), 0))


def test_no_block_is_longer_than_ten_lines():
    assert len(BLOCKS) >= 10
    assert max(len(block.splitlines()) for block in BLOCKS) <= 10


@pytest.fixture
def nothing_looked_for(monkeypatch, as_given):
    """Look for nothing that is wrong with images and cameras unless a block asks for it."""
    from tomo import Options

    but = Options.but
    given = {name: value for name, value in as_given.items() if name != "uncertainty"}
    monkeypatch.setattr(Options, "but", lambda self, **asked: but(self, **(given | asked)))


@pytest.mark.usefixtures("quick_choice", "coarse_scenes", "nothing_looked_for")
def test_the_blocks_run_in_their_order(tmp_path, monkeypatch, capsys):
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tomo.report.outcome_files.draw", lambda *_: ())  # most of the time
    photograph(tmp_path / "images")
    names = {}
    for block in BLOCKS:
        exec(compile(block, PAGE.name, "exec"), names)
    assert names["check"].assessment in capsys.readouterr().out
    assert {"volume.npz", "report.html", "report.json"} <= set(
        path.name for path in (tmp_path / "out/first").iterdir()
    )
    for page in ("coverage.html", "rig.html", "flame.html", "film.html", "calibration.html"):
        assert "<html" in (tmp_path / page).read_text("utf-8")
    assert (tmp_path / "flame.glb").read_bytes()[:4] == b"glTF"
    assert len(list((tmp_path / "volumes").iterdir())) == 2
    assert names["total"].shape == (3,)
    assert names["small"]["cam00"].image_size == (12, 18)
    assert names["calibration"].rig["cam00"].camera_matrix[0, 0] == pytest.approx(300, rel=0.01)
    assert names["grid_of_part"].shape == (8, 8, 8)
    assert names["again"].grid == names["grid_of_part"]
    assert names["steps"]
    assert (tmp_path / "out/demo/rig.png").read_bytes()[1:4] == b"PNG"
