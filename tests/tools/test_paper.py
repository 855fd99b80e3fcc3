"""The paper's experiments through their command, as small as they get."""

import dataclasses
import inspect
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from tomo import metrics
from tomo.wernet.paper import wernet_paper


@pytest.fixture(scope="module", autouse=True)
def one_thread(on_threads):
    """Threads that spin while they wait for each other take most of a busy machine's time."""
    with on_threads(1):
        yield


@pytest.fixture(scope="module")
def folder(run_tool, tmp_path_factory):
    out = tmp_path_factory.mktemp("paper")
    done = run_tool("paper", "--quick", "-o", out, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert json.loads(done.stdout)["page"] == str(out / "paper.md")
    return out


@pytest.fixture(scope="module")
def result(folder):
    return json.loads((folder / "paper" / "paper.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def studies(result):
    return {name: rows for p in result["parts"].values() for name, rows in p["studies"].items()}


def test_every_part_ran_and_is_on_the_page(folder, result, studies):
    from _paper import PARTS
    from _paper.page import TITLES

    assert tuple(result["parts"]) == PARTS
    text = (folder / "paper.md").read_text("utf-8")
    assert set(studies) == set(TITLES)
    assert all(f"## {title}" in text for title in TITLES.values())
    pictures = {path.name for path in (folder / "paper").glob("*.png")}
    assert {name for name in pictures if f"](paper/{name})" in text} == pictures
    assert "layouts_convergence.png" in pictures
    assert "denoising_sections_jet.png" in pictures


def test_training_comes_nearer_to_the_truth(studies):
    for row in studies["layouts"]:
        distances = [distance for _, distance, _ in row["course"]]
        assert len(distances) == row["epochs"]
        assert distances[-1] == row["cosine_distance"] < distances[0]
        assert min(distances) == row["best_cosine_distance"]
        residuals = [residual for _, _, residual in row["course"]]
        assert residuals[-1] < residuals[0]


def test_one_training_asked_for_twice_is_one(studies):
    """The ablation's bias-mask run is the normalised run of the jet."""
    first = next(row for row in studies["ablation"] if row["variant"] == "bias-mask")
    second = next(row for row in studies["normalisation"] if row["normalise_gradient"])
    assert first == second


def test_first_steps_are_those_of_the_solver(run_tool):
    """The step-wise run is the same training: after one epoch, the same volume."""
    from _paper.cases import case
    from _paper.sizes import QUICK
    from _paper.studies import LAYOUT, READING
    from _paper.training import first_steps, trained

    seen = case("jet", LAYOUT, QUICK.problem)
    row = trained("jet", LAYOUT, QUICK.problem, 1, READING)
    steps = first_steps(seen, READING, row["steps_per_epoch"])
    assert steps["cosine_distance"] == pytest.approx(row["cosine_distance"], rel=1e-4)
    # the mean of the squared residuals over the epoch, a batch weighing as many rays as it has
    assert np.mean(steps["losses"][:-1]) > 0
    assert len(steps["losses"]) == row["steps_per_epoch"]


def test_an_encoder_is_handed_on_untouched(run_tool):
    from _paper.sizes import QUICK
    from _paper.studies import LAYOUT, READING
    from _paper.training import Source, row_and_encoder

    source = Source("jet", LAYOUT, 1)
    args = ("turbulent", LAYOUT, QUICK.problem, 1, READING, 0.0, source)
    _, own = row_and_encoder("jet", LAYOUT, QUICK.problem, 1, READING, 0.0, None, False)
    before = {name: value.clone() for name, value in own.state_dict().items()}
    _, frozen = row_and_encoder(*args, True)
    _, moved = row_and_encoder(*args, False)
    same = [torch.equal(value, before[name]) for name, value in frozen.state_dict().items()]
    assert all(same)
    assert not all(torch.equal(v, before[name]) for name, v in moved.state_dict().items())
    assert all(torch.equal(v, before[name]) for name, v in own.state_dict().items())


def test_images_are_the_voxels_own_projection(run_tool):
    from _paper.cases import case
    from _paper.sizes import QUICK
    from _paper.studies import LAYOUT

    seen = case("jet", LAYOUT, QUICK.problem)
    projector = seen.system.projector
    active = projector.active.compress(seen.truth)
    outside = seen.truth.sum() - active.sum()
    assert outside < 1e-3 * seen.truth.sum()
    predicted = projector @ active.reshape(-1)
    assert np.abs(predicted - seen.measured).max() < 1e-2 * seen.measured.max()


def test_claims_hold_as_their_figures_say(run_tool, studies):
    from _paper.claims import claims

    row = dict(studies["layouts"][0])
    for distance, holds in ((5e-4, True), (2e-3, False)):
        claim, _ = claims({"layouts": [{**row, "cosine_distance": distance}]})
        assert claim["holds"] is holds
        assert bool(claim["why"]) is not holds
    runs = [{**studies["normalisation"][0], "normalise_gradient": n, "cosine_distance": d}
            for n, d in ((True, 0.001), (False, 0.5))]  # fmt: skip
    assert claims({"normalisation": runs})[0]["holds"]
    runs[1]["cosine_distance"] = 0.001
    assert not claims({"normalisation": runs})[0]["holds"]


@pytest.fixture
def stubs(run_tool, monkeypatch):
    """Put studies of no work in place of the real ones; return the list of those that ran."""
    from _paper import PARTS, studies

    ran = []
    monkeypatch.setattr(
        studies,
        "PARTS",
        {name: lambda sizes, progress, name=name: ran.append(name) or {} for name in PARTS},
    )
    return ran


def test_an_interrupted_run_goes_on(run_tool, stubs, monkeypatch, tmp_path):
    from _paper import studies

    def fail(sizes, progress):
        raise RuntimeError("the machine went away")

    working = studies.PARTS["views"]
    monkeypatch.setitem(studies.PARTS, "views", fail)
    assert run_tool("paper", "--quick", "-o", tmp_path).exit_code == 1
    assert stubs == ["readings", "layouts"]
    monkeypatch.setitem(studies.PARTS, "views", working)
    stubs.clear()
    assert run_tool("paper", "--quick", "--resume", "-o", tmp_path).exit_code == 0
    assert stubs == ["views", "ablation", "normalisation", "denoising", "transfer"]


def test_only_what_is_asked_runs(run_tool, stubs, tmp_path):
    done = run_tool("paper", "--quick", "-o", tmp_path, "--part", "views", "--part", "layouts")
    assert done.exit_code == 0
    assert stubs == ["views", "layouts"]


def test_bad_input_is_one_line(run_tool, stubs, tmp_path):
    done = run_tool("paper", "--part", "speed", "-o", tmp_path)
    assert done.exit_code == 2
    assert "--part: found 'speed', expected one of readings, layouts" in done.stderr
    (tmp_path / "file").write_text("x")
    done = run_tool("paper", "--quick", "-o", tmp_path / "file")
    assert done.exit_code == 2
    assert "is a file, expected a folder" in done.stderr


def test_another_run_is_not_gone_on_with(run_tool, stubs, tmp_path):
    assert run_tool("paper", "--quick", "-o", tmp_path).exit_code == 0
    done = run_tool("paper", "--half", "--resume", "-o", tmp_path)
    assert done.exit_code == 2
    assert "--resume: size: found 'quick', expected 'half'" in done.stderr
    file = tmp_path / "paper" / "paper.json"
    for content in ("{", "[]", '{"format": "x"}'):
        file.write_text(content, "utf-8")
        done = run_tool("paper", "--quick", "--resume", "-o", tmp_path)
        assert done.exit_code == 2
        assert "expected the result of an earlier run" in done.stderr


def test_steps_of_their_own_are_the_solver_s(run_tool):
    """The loop for readings that the solver does not know gives its volumes on those it does."""
    from _paper.cases import case
    from _paper.sizes import QUICK
    from _paper.steps import epochs
    from _paper.studies import LAYOUT, READING
    from _paper.training import trained

    seen = case("jet", LAYOUT, QUICK.problem)
    row = trained("jet", LAYOUT, QUICK.problem, 2, READING)
    found = list(epochs(seen, READING, READING.encoder(), 2))
    assert [epoch for epoch, _, _ in found] == [1, 2]
    residuals = [residual for _, _, residual in row["course"]]
    assert [residual for _, _, residual in found] == pytest.approx(residuals, rel=1e-4)
    volume = seen.system.projector.active.expand(found[-1][1]).reshape(seen.truth.shape)
    assert metrics.nrmse(volume, seen.truth) == pytest.approx(row["nrmse"], rel=1e-4)


@pytest.mark.parametrize(
    "changes",
    [{"norm": "batch"}, {"loss": "absolute"}, {"first_voxels": 1.0}, {"inputs": "unscaled"}],
    ids=str,
)
def test_a_reading_that_the_solver_does_not_know_is_another_training(run_tool, changes):
    from _paper.sizes import QUICK
    from _paper.studies import LAYOUT, READING
    from _paper.training import trained

    usual = trained("jet", LAYOUT, QUICK.problem, 3, READING)
    row = trained("jet", LAYOUT, QUICK.problem, 3, replace(READING, **changes))
    assert len(row["course"]) == 3
    distances = [distance for _, distance, _ in row["course"]]
    assert distances[-1] == row["cosine_distance"] < distances[0]
    assert row["cosine_distance"] != pytest.approx(usual["cosine_distance"], rel=1e-3)


def test_finer_images_have_pixels_half_as_wide(run_tool):
    from _paper.cases import FINER, case
    from _paper.sizes import QUICK
    from _paper.studies import LAYOUT

    coarse, fine = (case("jet", name, QUICK.problem) for name in (LAYOUT, LAYOUT + FINER))
    assert np.array_equal(coarse.truth, fine.truth)
    points = np.array([[0.0, 0.0, 0.0], [5.0, -30.0, 3.0]])
    for camera, finer in zip(coarse.system.rig, fine.system.rig, strict=True):
        pixels, _, _ = camera.project(points)
        halves, _, _ = finer.project(points)
        assert halves == pytest.approx(2 * pixels + 0.5)  # a pixel's centre is a whole number
    total = [sum(float(image.sum()) for image in c.images) for c in (coarse, fine)]
    assert total[1] / 4 == pytest.approx(total[0], rel=0.05)


def test_art_not_relaxed_keeps_more_noise(studies):
    for flame in ("jet", "turbulent"):
        for layout in {row["layout"] for row in studies["art"]}:
            best, _, plain = (
                row["cosine_distance"]
                for row in studies["art"]
                if (row["flame"], row["layout"]) == (flame, layout)
            )
            assert best < plain


@pytest.mark.parametrize(
    ("change", "known"),
    [
        ({}, True),
        ({"inputs": "absolute", "blocks": 2, "variant": "no-bias", "first_bias": None}, True),
        ({"voxel_learning_rate": 0.1, "normalise_gradient": False}, True),
        ({"inputs": "unscaled"}, False),
        ({"norm": "batch"}, False),
        ({"loss": "absolute"}, False),
        ({"first_voxels": 1.0}, False),
    ],
)
def test_a_reading_asks_the_solver_for_what_it_takes_and_no_more(change, known):
    from _paper.training import Reading

    reading = Reading(**change)
    assert reading.known_to_solver is known
    taken = set(inspect.signature(wernet_paper).parameters)
    asked = set(reading.options())
    assert asked <= taken
    # what is asked for and what is not make up a reading; the encoder is built by the study
    left = {field.name for field in dataclasses.fields(Reading)} - asked
    assert left == {"variant", "blocks", "first_bias", "norm", "loss", "first_voxels"}
    assert not left & taken - {"variant", "blocks"}
