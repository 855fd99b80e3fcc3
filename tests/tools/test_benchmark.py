"""The benchmark through its command, as small as it gets: do its rows make sense together?"""

import json

import cv2
import numpy as np
import pytest

from tomo import solvers


@pytest.fixture(scope="module", autouse=True)
def quiet_threads(on_threads):
    """Threads that spin while they wait for each other take most of a busy machine's time."""
    with pytest.MonkeyPatch.context() as patch, on_threads(1):
        patch.setenv("OMP_WAIT_POLICY", "passive")  # of processes that the benchmark starts
        yield


@pytest.fixture(scope="module")
def folder(run_tool, tmp_path_factory):
    out = tmp_path_factory.mktemp("benchmark")
    done = run_tool("benchmark", "--tiny", "-o", out, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert json.loads(done.stdout)["page"] == str(out / "benchmark.md")
    return out


@pytest.fixture(scope="module")
def result(folder):
    return json.loads((folder / "benchmark.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def studies(result):
    return {name: rows for p in result["parts"].values() for name, rows in p["studies"].items()}


def only(rows, **wanted):
    found = [row for row in rows if all(row[key] == value for key, value in wanted.items())]
    assert found, wanted
    return found


def test_every_part_ran_on_a_machine_that_is_named(result):
    from _benchmark import PARTS

    assert tuple(result["parts"]) == PARTS
    assert all(part["seconds"] > 0 for part in result["parts"].values())
    assert result["machine"]["cores"] >= 1
    assert result["machine"]["versions"]["numpy"] == np.__version__
    assert "real plume was left out" in result["parts"]["skipping"]["notes"][0]


def test_solvers_come_nearer_to_the_truth_as_time_goes_by(studies):
    rows = studies["solvers"]
    assert {row["method"] for row in rows} == {*solvers.METHODS, "auto"}
    for row in rows:
        assert 0 < row["cosine_distance"] < 0.7
        assert row["nrmse"] > 0
        assert row["prepare_seconds"] < row["seconds"]
        if row["method"] == "auto":
            continue
        seconds, distances, nrmses = np.transpose(row["course"])
        assert (np.diff(seconds) > 0).all()
        assert seconds[0] > 0
        assert distances[row["best_pass"]] == row["cosine_distance"] == distances.min()
        assert nrmses[row["best_pass"]] == row["nrmse"] < 1
        assert row["best_pass"] > 0


def test_means_are_of_the_runs(studies):
    runs, means = studies["solvers"], studies["solvers_mean"]
    for row in means:
        scene = {key: row[key] for key in ("flame", "views", "noise")}
        mine = [r["cosine_distance"] for r in only(runs, method=row["method"], **scene)]
        art = [r["cosine_distance"] for r in only(runs, method="art", **scene)]
        assert len(mine) == row["seeds"]
        assert row["cosine_distance"] == pytest.approx(np.mean(mine))
        assert row["of_best_art"] == pytest.approx(np.mean(mine) / np.mean(art))
    noisy, clean = (only(means, method="art", views=33, noise=n)[0] for n in ("gaussian", "clean"))
    assert noisy["cosine_distance"] > clean["cosine_distance"]


def test_what_is_not_told_costs_accuracy(studies):
    rows, means = studies["mismatch"], studies["mismatch_mean"]
    assert [row["effect"] for row in means] == ["gains", "gains", "all", "all"]
    assert {row["noise"] for row in rows} == {"clean", "2 %"}
    for row, mean in zip(rows, means, strict=True):
        assert row["tried"][row["classic"]] == min(row["tried"].values())
        assert row["classic_cosine_distance"] == row["tried"][row["classic"]] < 0.1
        assert row["classic_seconds"] > 0
        assert mean["classic_cosine_distance"] == row["classic_cosine_distance"]  # one seed
    told, untold = (only(means, effect="all", noise="clean")[0][f"{who}_cosine_distance"]
                    for who in ("informed", "classic"))  # fmt: skip
    assert told < 0.8 * untold


def test_exact_data_are_matched_sooner_by_better_methods(studies):
    rows = studies["consistent"]
    for row in rows:
        seconds, distances = np.transpose(row["course"])
        assert (np.diff(seconds) > 0).all()
        assert distances[-1] < 0.6 * distances[1]
    sirt = only(rows, method="sirt", skip=False)[0]
    cgls = only(rows, method="cgls", skip=True)[0]
    assert cgls["segments"] <= sirt["segments"]
    assert cgls["active_voxels"] <= sirt["active_voxels"]
    assert min(d for _, d in cgls["course"]) < min(d for _, d in sirt["course"])


def test_skipping_is_compared_with_itself(studies):
    rows = studies["skipping"]
    assert len(rows) % 2 == 0
    for on in only(rows, skip=True):
        case = {key: on[key] for key in ("flame", "noise", "method")}
        (off,) = only(rows, skip=False, **case)
        assert on["segments"] <= off["segments"]
        assert on["active_voxels"] <= off["active_voxels"]
        assert on["cosine_distance"] == pytest.approx(off["cosine_distance"], rel=0.5)


def test_what_the_truth_would_let_be_left_out(studies):
    rows = only(studies["skippable"], flame="jet")
    skipped, plain = (
        only(studies["skipping"], flame="jet", method="auto", noise="clean", skip=skip)[0]
        for skip in (True, False)
    )
    every = [row["segments"] * row["fewer"] for row in rows]
    assert every == pytest.approx([plain["segments"]] * len(rows), rel=0.01)
    for key, ascends in (("fewer", True), ("cosine_distance", True), ("active_voxels", False)):
        values = [row[key] for row in rows]
        assert values == sorted(values, reverse=not ascends)
    assert rows[0]["cosine_distance"] == pytest.approx(0, abs=1e-12)
    assert rows[0]["active_voxels"] <= skipped["active_voxels"]  # the hull holds all that emits


def test_the_best_classic_method_is_of_either_basis_and_stopped_by_the_truth(studies):
    for row in studies["basis"]:
        assert row["stopped_cosine_distance"] <= 1.05 * row["boxes_cosine_distance"]
    for mean in studies["basis_mean"]:
        ratio = mean["splines_cosine_distance"] / mean["stopped_cosine_distance"]
        assert mean["of_stopped"] == pytest.approx(ratio)


def test_time_and_memory_are_measured_case_by_case(studies):
    by_edge = only(studies["scaling_edge"], form="on-the-fly")
    segments = [row["segments"] for row in by_edge]
    assert segments == sorted(segments)
    assert segments[0] < segments[-1]
    for row in [*studies["scaling_edge"], *studies["scaling_views"], *studies["memory_target"]]:
        assert row["peak_bytes"] >= row["trace_bytes"] >= 0
        assert row["voxels"] == row["edge"] ** 3
        assert row["needed_bytes"] == 4 * (row["views"] * row["pixels"] ** 2 + 2 * row["voxels"])
        assert min(row["trace_seconds"], row["forward_seconds"], row["adjoint_seconds"]) > 0
    stored = only(studies["scaling_edge"], form="stored", edge=by_edge[0]["edge"])[0]
    assert stored["segments"] == pytest.approx(by_edge[0]["segments"], rel=0.01)


def test_speed_up_is_over_one_thread(studies):
    rows = studies["threads"]
    for row in rows:
        case = {key: row[key] for key in ("form", "product")}
        (one,) = only(rows, threads=1, **case)
        assert row["speed_up"] == pytest.approx(one["seconds"] / row["seconds"])
    limits = {row["product"] for row in only(rows, form="the machine")}
    assert limits == {"arithmetic", "waiting", "reading"}


def test_a_process_takes_at_least_as_long_as_its_steps(studies):
    rows = studies["startup"]
    for what in ("import tomo", "kernels", "reconstruct"):
        steps = only(rows, what=what)
        whole = only(steps, step="whole process")[0]["warm"]
        assert whole > sum(row["warm"] for row in steps if row["step"] != "whole process") > 0


def test_what_was_wanted_is_judged_by_the_rows(result, studies, folder):
    claims = {claim["what"]: claim for claim in result["claims"]}
    (row,) = studies["memory_target"]
    (claim,) = [c for what, c in claims.items() if "memory over images" in what]
    assert claim["value"] == pytest.approx(row["peak_bytes"] / row["needed_bytes"])
    assert claim["met"] == (claim["value"] <= 1.5)
    on, off = (only(studies["skipping"], method="auto", noise="clean", skip=s)[0] for s in (1, 0))
    claim = claims["jet, clean: segments without skipping over with"]
    assert claim["value"] == pytest.approx(off["segments"] / on["segments"])
    page = (folder / "benchmark.md").read_text("utf-8")
    assert all(what in page for what in claims)


def test_the_page_shows_every_plot(folder):
    page = (folder / "benchmark.md").read_text("utf-8")
    plots = sorted((folder / "benchmark").glob("*.png"))
    assert len(plots) >= 6
    for plot in plots:
        assert f"](benchmark/{plot.name})" in page
        picture = cv2.imread(str(plot))
        assert min(picture.shape[:2]) > 500
        assert picture.std() > 10
    tables = [line for line in page.splitlines() if line.startswith("|")]
    assert len(tables) > 60
    assert "nan" not in page.lower().replace("nanometre", "")
