"""The paper's experiments through their command, as small as they get."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from studies.paper import STUDY
from studies.paper.cases import FINER, case
from studies.paper.experiments import LAYOUT, READING
from studies.paper.sizes import SIZES
from studies.paper.training import Reading, Source, row_and_encoder, trained

PROBLEM = SIZES["tiny"].problem


@pytest.fixture(scope="module")
def folder(run_tool, tmp_path_factory):
    out = tmp_path_factory.mktemp("paper")
    done = run_tool("paper", "--size", "tiny", "-o", out, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert json.loads(done.stdout)["page"] == str(out / "paper.md")
    return out


@pytest.fixture(scope="module")
def tables(folder):
    parts = json.loads((folder / "paper.json").read_text("utf-8"))["parts"]
    return {part: record["tables"] for part, record in parts.items()}


def test_every_part_ran_and_is_on_the_page(folder, tables):
    assert tuple(tables) == tuple(STUDY.parts)
    text = (folder / "paper.md").read_text("utf-8")
    assert all(f"## {title}" in text for title, _ in STUDY.parts.values())
    pictures = {path.name for path in (folder / "paper").glob("*.png")}
    assert {name for name in pictures if f"](paper/{name})" in text} == pictures
    assert pictures == {f"{part}.png" for part in STUDY.parts}


def test_training_comes_nearer_to_the_truth():
    row = trained("jet", LAYOUT, PROBLEM, 4, READING)
    distances = [distance for _, distance, _ in row["curves"]]
    assert len(distances) == row["epochs"] == 4
    assert distances[-1] == row["cosine_distance"] < distances[0]
    assert min(distances) == row["best_cosine_distance"]
    residuals = [residual for _, _, residual in row["curves"]]
    assert residuals[-1] < residuals[0]


def test_one_training_asked_for_twice_is_one(tables):
    """The ablation's bias-mask run is the normalised run of the jet."""
    rows = tables["ablation"]["ablation"], tables["normalisation"]["normalisation"]
    first = next(row for row in rows[0] if row["variant"] == "bias-mask")
    second = next(row for row in rows[1] if row["normalise_gradient"])
    assert first == second


def test_an_encoder_is_handed_on_untouched():
    source = Source("jet", LAYOUT, 1)
    args = ("turbulent", LAYOUT, PROBLEM, 1, READING, 0.0, source)
    _, own = row_and_encoder("jet", LAYOUT, PROBLEM, 1, READING, 0.0, None, False)
    before = {name: value.clone() for name, value in own.state_dict().items()}
    _, frozen = row_and_encoder(*args, True)
    _, moved = row_and_encoder(*args, False)
    same = [torch.equal(value, before[name]) for name, value in frozen.state_dict().items()]
    assert all(same)
    assert not all(torch.equal(v, before[name]) for name, v in moved.state_dict().items())
    assert all(torch.equal(v, before[name]) for name, v in own.state_dict().items())


def test_images_are_the_voxels_own_projection():
    seen = case("jet", LAYOUT, PROBLEM)
    projector = seen.system.projector
    active = projector.active.compress(seen.truth)
    outside = seen.truth.sum() - active.sum()
    assert outside < 1e-3 * seen.truth.sum()
    predicted = projector @ active.reshape(-1)
    assert np.abs(predicted - seen.measured).max() < 1e-2 * seen.measured.max()


def test_claims_say_what_was_found(tables):
    for part, claims in ((part, t["claims"]) for part, t in tables.items() if "claims" in t):
        for claim in claims:
            assert isinstance(claim["agrees"], bool), part
            assert 0 <= claim["found"] <= 1
    (claim,) = tables["normalisation"]["claims"]
    on, off = (row["cosine_distance"] for row in tables["normalisation"]["normalisation"])
    assert claim["agrees"] is (off > 10 * on)


def test_finer_images_have_pixels_half_as_wide():
    coarse, fine = (case("jet", name, PROBLEM) for name in (LAYOUT, LAYOUT + FINER))
    assert np.array_equal(coarse.truth, fine.truth)
    points = np.array([[0.0, 0.0, 0.0], [5.0, -30.0, 3.0]])
    for camera, finer in zip(coarse.system.rig, fine.system.rig, strict=True):
        pixels, _, _ = camera.project(points)
        halves, _, _ = finer.project(points)
        assert halves == pytest.approx(2 * pixels + 0.5)  # a pixel's centre is a whole number
    total = [sum(float(image.sum()) for image in c.images) for c in (coarse, fine)]
    assert total[1] / 4 == pytest.approx(total[0], rel=0.05)


def test_art_not_relaxed_keeps_more_noise(tables):
    rows = tables["denoising"]["art"]
    for best, plain in zip(rows[::2], rows[1::2], strict=True):
        assert (best["stopped"], plain["stopped"]) == ("best", "plain")
        assert best["cosine_distance"] < plain["cosine_distance"]


def test_settings_of_the_solver_are_those_of_a_reading():
    reading = Reading(inputs="absolute", samples_per_batch=3, blocks=2)
    settings = dataclasses.asdict(reading.settings())
    own = dataclasses.asdict(reading)
    ours = {"first_bias", "seed"}  # the study builds the encoder, and hands the seed on
    assert own.keys() - settings.keys() == ours
    assert {name: settings[name] for name in own.keys() - ours} == {
        name: own[name] for name in own.keys() - ours
    }
