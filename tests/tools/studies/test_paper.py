"""The paper's rows through their command, as small as they get."""

import json

import numpy as np
import pytest
import torch
from studies.paper import study
from studies.paper.cases import CASE_3, FINE, LAYOUTS, Layout, rig_of, truth_of
from studies.paper.rows import CLAIMS, FULL, PARTS, READINGS, ROWS, TINY
from studies.paper.training import written_settings

from tomo import metrics
from tomo.wernet import PaperSettings, load_encoder, load_settings

WANTED = ("jet-noise-plain-art", "jet-noise-best-art", "homogeneous-to-jet", "jet-noise")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("paper")
    study.run_rows([ROWS[name] for name in WANTED], out, "tiny")
    return out


def records(folder):
    return json.loads((folder / "paper.json").read_text("utf-8"))["rows"]


def test_rows_and_those_whose_encoder_they_need_are_kept_and_on_the_page(folder):
    rows = records(folder)
    assert list(rows) == [
        "jet-noise-plain-art", "jet-noise-best-art", "homogeneous", "homogeneous-to-jet",
        "jet-noise",
    ]  # fmt: skip
    text = (folder / "paper.md").read_text("utf-8")
    for name in rows:
        assert f"python tools/paper.py --row {name} -o out/paper --size tiny" in text
    judged = [claim.words for claim in CLAIMS if set(claim.rows) <= set(rows)]
    assert len(judged) == 3
    assert all(words in text for words in judged)
    pictures = {path.name for path in (folder / "paper").glob("*.png")}
    assert pictures == {
        "noise_convergence.png", "noise_sections.png", "transfer_convergence.png",
    }  # fmt: skip
    assert all(f"](paper/{name})" in text for name in pictures)


def test_a_row_says_where_its_volume_ended(folder):
    row = records(folder)["jet-noise"]
    volume = np.load(folder / "volumes" / "jet-noise.npy", allow_pickle=False)
    distance = metrics.cosine_distance(volume, truth_of("jet", TINY))
    assert row["cosine_distance"] == pytest.approx(distance, rel=1e-4)
    assert row["curve"][-1][1] == pytest.approx(distance, rel=1e-4)
    assert len(row["curve"]) == row["epochs"] == 2
    best = records(folder)["jet-noise-best-art"]
    assert best["cosine_distance"] == best["best_cosine_distance"]


def test_a_frozen_encoder_is_handed_on_untouched(folder):
    first, second = (
        load_encoder(folder / "encoders" / f"{name}.pt").state_dict()
        for name in ("homogeneous", "homogeneous-to-jet")
    )
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_an_interrupted_run_goes_on_with_the_rows_that_are_not_done(tmp_path, monkeypatch):
    wanted = [ROWS[name] for name in WANTED[:2]]
    plain = study.measured_row

    def stopped(row, out, say):
        if row.name == wanted[1].name:
            raise KeyboardInterrupt
        return plain(row, out, say)

    monkeypatch.setattr(study, "measured_row", stopped)
    with pytest.raises(KeyboardInterrupt):
        study.run_rows(wanted, tmp_path, "tiny")
    first = records(tmp_path)
    assert list(first) == [wanted[0].name]
    monkeypatch.setattr(study, "measured_row", plain)
    result = study.run_rows(wanted, tmp_path, "tiny")
    assert list(result["rows"]) == [row.name for row in wanted]
    assert result["rows"][wanted[0].name] == first[wanted[0].name]
    with pytest.raises(ValueError, match="size: found 'tiny', expected 'full'"):
        study.run_rows(wanted, tmp_path, "full")
    (tmp_path / "paper.json").write_text("[]")
    with pytest.raises(ValueError, match=r"paper\.json: expected the result of an earlier paper"):
        study.run_rows(wanted, tmp_path, "tiny")


def test_the_command_takes_rows_parts_and_quick(run_tool, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        study, "run_rows", lambda rows, out, size: asked.append(([r.name for r in rows], size))
    )
    for arguments in ((), ("--row", "jet"), ("--part", "views", "--size", "quick"),
                      ("--row", "jet", "--part", "views")):  # fmt: skip
        assert run_tool("paper", "-o", tmp_path, *arguments).exit_code == 0
    views = [row.name for row in ROWS.values() if row.part == "views"]
    assert asked == [
        (list(ROWS), "full"), (["jet"], "full"), (views, "quick"), (["jet", *views], "full"),
    ]  # fmt: skip
    done = run_tool("paper", "-o", tmp_path, "--row", "fire")
    assert done.exit_code == 2
    assert "--row: found 'fire', expected one of jet, jet-level" in done.stderr


def test_every_row_trains_by_a_file_of_settings(tmp_path):
    for row in ROWS.values():
        assert written_settings(row, tmp_path) == row.settings
        path = tmp_path / "settings" / f"{row.name}.yaml"
        assert load_settings(path, PaperSettings) == row.settings
    assert ROWS["reading-text"].settings == load_settings("paper-text", PaperSettings)
    assert {f"reading-{name}" for name in READINGS} <= set(ROWS)


def test_claims_and_parts_name_rows_that_are_there():
    assert {name for claim in CLAIMS for name in claim.rows} <= set(ROWS)
    assert {row.part for row in ROWS.values()} == set(PARTS)
    assert {row.encoder_of for row in ROWS.values()} - {""} <= set(ROWS)


def test_only_rows_that_compare_layouts_have_another_layout_and_claims_one_reading():
    for row in ROWS.values():
        assert row.layout == CASE_3 or row.part in ("layouts", "views")
        assert row.settings == PaperSettings() or row.part in ("ablation", "readings", "noise")
    claimed = {name for claim in CLAIMS for name in claim.rows}
    for name in claimed - {name for name in claimed if ROWS[name].part == "ablation"}:
        assert ROWS[name].settings == PaperSettings()
        assert ROWS[name].grid == FULL


def heights_of_rows(layout, grid):
    """Return the height of every image row in voxels, in the plane through the axis."""
    camera = rig_of(layout, grid)[0]
    rows = np.arange(camera.image_size[1]) - camera.camera_matrix[1, 2]
    return rows * layout.pixel


def test_rows_of_level_images_are_off_the_faces_of_voxels_or_all_on_them():
    level, on_faces = LAYOUTS["case 1, level"], LAYOUTS["case 1, rows on faces"]
    off = np.abs((heights_of_rows(level, FULL) + 0.5) % 1 - 0.5)
    assert off.min() == pytest.approx(1 / 6)
    heights = heights_of_rows(on_faces, FULL)
    np.testing.assert_allclose(heights, np.round(heights), atol=1e-9)


def test_case_3_is_pitched_by_15_degrees_at_random_distances():
    positions = np.array([camera.position for camera in rig_of(LAYOUTS[CASE_3], FULL)])
    distances = np.linalg.norm(positions, axis=1)
    pitch = np.rad2deg(np.arcsin(positions[:, 1] / distances))
    np.testing.assert_allclose(pitch, np.where(np.arange(33) % 2, -15, 15), atol=1e-6)
    assert 5500 < distances.min() < 5650
    assert 6350 < distances.max() < 6500


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_image_holds_the_whole_grid(name):
    rig = rig_of(LAYOUTS[name], FULL)
    assert len(rig) == LAYOUTS[name].views
    for camera in rig:
        pixels, _, valid = camera.project(truth_corners())
        assert valid.all()
        assert camera.inside(pixels).all()
    distances = np.array([np.linalg.norm(camera.position) for camera in rig])
    widths = LAYOUTS[name].pixel * 0.5 * distances / 5800
    np.testing.assert_allclose(rig.footprint(), widths, rtol=1e-6)


def truth_corners():
    x, y, z = np.meshgrid(*([-1, 1],) * 3, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3) * FULL.extent / 2


def test_pixels_are_as_fine_as_the_text_s_96_steps_an_epoch_imply():
    rays = 33 * 30 * 140 / FINE**2
    assert rays == pytest.approx(96 * 3200, rel=0.02)
    assert Layout().pixel == FINE


@pytest.mark.parametrize(
    ("words", "distances", "holds"),
    [
        ("jet, 33 views, level layout: distance", [0.0009], True),
        ("jet, 33 views, level layout: distance", [0.001], False),
        ("turbulent flame: 33 views", [0.01, 0.02, 0.03, 0.04], True),
        ("turbulent flame: 33 views", [0.01, 0.02, 0.009, 0.04], False),
        ("an encoder without bias", [0.3, 0.1, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.9], True),
        ("an encoder without bias", [0.3, 0.1, 0.2, 0.1, 0.1, 0.1, 0.3, 0.3, 0.1], False),
        ("without gradient normalisation", [0.011, 0.001], True),
        ("without gradient normalisation", [0.009, 0.001], False),
        ("jet, 10 % noise: similarity above unrelaxed", [0.1, 0.2], True),
        ("jet, 10 % noise: similarity above best", [0.2, 0.1], False),
        ("encoder of the turbulent flame, frozen", [0.07], True),
        ("encoder of the homogeneous set, frozen, for the jet", [0.0005], True),
        ("encoder of the homogeneous set, frozen, for the jet", [0.0015], False),
    ],
)
def test_claims_are_judged_by_their_rows(words, distances, holds):
    (claim,) = [one for one in CLAIMS if one.words.startswith(words)]
    rows = {
        name: {"cosine_distance": distance, "curve": [[1, 0.5, 0.1], [39, distance, 0.01]]}
        for name, distance in zip(claim.rows, distances, strict=True)
    }
    assert claim.row(rows)["holds"] is holds
    rows.popitem()
    assert claim.row(rows)["holds"] is None


def test_what_is_reached_at_epoch_40_is_too_late():
    (claim,) = [one for one in CLAIMS if one.words.startswith("encoder of the homogeneous set, f")
                and "jet" in one.words]  # fmt: skip
    row = {"curve": [[39, 0.0011, 0.01], [40, 0.0001, 0.01]]}
    assert claim.row({claim.rows[0]: row})["holds"] is False
