"""The benchmark as small as it gets: do its rows make sense together?"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from studies.benchmark import STUDY, accuracy, plume, projectors
from studies.benchmark import solvers as solver_part
from studies.benchmark.convergence import means
from studies.common.study import Request

from tomo import solvers

pytestmark = pytest.mark.usefixtures("quick_choices")

TOOLS = Path(__file__).resolve().parents[3] / "tools"
PARTS = ("projectors", "solvers", "skipping", "plume", "training")


@pytest.fixture(scope="module")
def folder(run_tool, tmp_path_factory, images_as_given):
    out = tmp_path_factory.mktemp("benchmark")
    parts = [word for part in PARTS for word in ("--part", part)]
    with pytest.MonkeyPatch.context() as patch:  # one rig and two noises are all kinds of rows
        patch.setattr(projectors, "_joseph", lambda *given: [])  # see test_emission
        patch.setattr(solver_part, "warm_up", lambda: None)
        patch.setattr(plume, "warm_up", lambda: None)
        patch.setattr(solver_part, "RIGS", (33,))
        patch.setattr(solver_part, "NOISES", ("clean", "gaussian"))
        done = run_tool(
            "benchmark", "--size", "tiny", "--processes", 1, *parts, "-o", out, "--json"
        )
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert json.loads(done.stdout)["page"] == str(out / "benchmark.md")
    return out


@pytest.fixture(scope="module")
def result(folder):
    return json.loads((folder / "benchmark.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def tables(result):
    return {name: rows for p in result["parts"].values() for name, rows in p["tables"].items()}


def only(rows, **wanted):
    found = [row for row in rows if all(row[key] == value for key, value in wanted.items())]
    assert found, wanted
    return found


def test_the_machine_is_named_and_the_page_shows_every_plot(folder, result):
    assert tuple(result["parts"]) == PARTS
    assert result["machine"]["cores"] >= 1
    assert result["machine"]["versions"]["numpy"] == np.__version__
    text = (folder / "benchmark.md").read_text("utf-8")
    plots = sorted((folder / "benchmark").glob("*.png"))
    assert [plot.stem for plot in plots] == ["solvers_jet"]
    assert all(f"](benchmark/{plot.name})" in text for plot in plots)
    assert "nan" not in text.lower().replace("nanometre", "")


def test_rates_are_of_the_same_rays(tables):
    for row in tables["projectors"]:
        assert row["rays_per_second"] == pytest.approx(row["rays"] / row["seconds"], rel=1e-3)
    forward, adjoint = (
        only(tables["projectors"], what=f"on the fly {way}", threads=1)[0]
        for way in ("forward", "adjoint")
    )
    assert adjoint["ratio"] == pytest.approx(forward["seconds"] / adjoint["seconds"], rel=1e-3)


def test_solvers_come_near_the_truth(tables):
    rows = tables["solvers"]
    assert {row["method"] for row in rows} == {*solvers.METHODS, "auto"}
    for row in rows:
        assert 0 < row["cosine_distance"] < 0.7
        assert row["nrmse"] > 0
        assert row["prepare_seconds"] < row["seconds"]
        scene = {key: row[key] for key in ("flame", "views", "noise")}
        (art,) = only(rows, method="art", **scene)
        expected = row["cosine_distance"] / art["cosine_distance"]
        assert row["of_best_art"] == pytest.approx(expected, rel=1e-3)
    noisy, clean = (only(rows, method="art", views=33, noise=n)[0] for n in ("gaussian", "clean"))
    assert noisy["cosine_distance"] > clean["cosine_distance"]


def test_means_are_over_the_seeds():
    rows = [
        {"flame": flame, "seed": seed, "best": best, "nrmse": nrmse}
        for flame, seed, best, nrmse in (
            ("jet", 1, "cgls", 0.02), ("jet", 2, "mlem", 0.04), ("sheet", 1, "mlem", 0.1),
        )
    ]  # fmt: skip
    jet, sheet = means(rows, "flame")
    assert jet == {"flame": "jet", "seeds": 2, "best": "cgls / mlem", "nrmse": pytest.approx(0.03)}
    assert (sheet["seeds"], sheet["nrmse"]) == (1, 0.1)


def test_skipping_is_compared_with_itself(tables):
    rows = tables["skipping"]
    assert len(rows) % 2 == 0
    for on in only(rows, skip=True):
        case = {key: on[key] for key in ("flame", "noise", "method")}
        (off,) = only(rows, skip=False, **case)
        assert on["segments"] <= off["segments"]
        assert on["live_voxels"] <= off["live_voxels"]
        assert on["cosine_distance"] == pytest.approx(off["cosine_distance"], rel=0.5)


def test_forms_of_training_are_timed_on_the_same_rays(tables):
    from studies.benchmark.training import VARIANTS, forms

    rows = tables["training"]
    assert [(r["variant"], r["layout"], r["skip"], r["device"]) for r in rows] == [
        (variant, *form) for variant in VARIANTS for form in forms()
    ]
    for row in rows:
        expected = row["seconds"] * row["rays"] / row["timed_rays"]
        assert row["epoch_seconds"] == pytest.approx(expected, rel=1e-3)
    plain, _, packed, skipped = rows[:4]
    assert plain["timed_rays"] == packed["timed_rays"] == 3200
    share = skipped["timed_rays"] / skipped["rays"]
    assert share == pytest.approx(plain["timed_rays"] / plain["rays"], rel=0.05)


def test_time_and_memory_are_measured_case_by_case():
    from studies.benchmark.scaling import _measured

    small, large = (
        _measured({"edge": edge, "views": 3, "pixels": edge, "form": "on-the-fly"}, 1)
        for edge in (8, 12)
    )
    assert small["segments"] < large["segments"]
    for row in (small, large):
        assert row["peak_bytes"] >= row["trace_bytes"] >= 0
        assert row["needed_bytes"] == 4 * (3 * row["pixels"] ** 2 + 2 * row["edge"] ** 3)
        assert min(row["trace_seconds"], row["forward_seconds"], row["adjoint_seconds"]) > 0


def test_a_process_takes_longer_the_more_it_does():
    rows = STUDY.measure("startup", Request("tiny"))["startup"]
    seconds = {row["what"]: row["warm"] for row in rows}
    assert 0 < seconds["python"] < seconds["kernels"]
    assert seconds["import tomo"] < seconds["reconstruct"]


def test_the_default_is_compared_with_the_best_classic_method(monkeypatch):
    monkeypatch.setattr(accuracy, "warm_up", lambda: None)
    monkeypatch.setattr(accuracy, "RIGS", (33,))
    monkeypatch.setattr(accuracy, "NOISES", ("gaussian",))
    for row in STUDY.measure("accuracy", Request("tiny"))["accuracy"]:
        assert row["best_classical_cosine_distance"] <= 1.05 * row["voxel_cosine_distance"]
        assert row["nrmse"] ** 2 == pytest.approx(2 * row["cosine_distance"], rel=0.2)
        assert 0 < row["seconds"] < row["whole_seconds"]


def test_blobs_are_judged_as_the_volume_that_they_make():
    from studies.benchmark.convergence import converged
    from studies.benchmark.sizes import SIZES
    from studies.common.flames import scene
    from studies.common.scans import problem

    scan = scene("jet", 33, "clean", 1, SIZES["tiny"].shown).scan
    ready = problem(scan.rig, scan.grid, list(scan.images.values()), skip=True)
    voxels, narrow, wide = (
        converged(ready, scan.truth, "nnls", {}, passes=4, width=width)
        for width in (0.0, 1e-3, 1.0)
    )
    assert narrow.cosine_distances == voxels.cosine_distances
    assert wide.cosine_distances[-1] != voxels.cosine_distances[-1]
    assert wide.cosine_distances[-1] < 0.3


MEMORY = """
import json, sys
import numpy as np
from studies.common import timing

timing.forget_the_peak()
seen = [timing.peak_resident()]
block = np.ones(2**24, np.float32)  # 64 MiB
seen.append(timing.peak_resident())
del block
seen.append(timing.peak_resident())
timing.forget_the_peak()
seen.append(timing.peak_resident())
sys.stdout.write(json.dumps(seen))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no high-water mark")
def test_memory_given_back_is_not_counted():
    # in a process of its own, as the benchmark does: others' threads give memory back meanwhile
    done = subprocess.run(
        [sys.executable, "-c", MEMORY], cwd=TOOLS, capture_output=True, text=True, check=True
    )
    before, during, after, anew = json.loads(done.stdout)
    size = 2**26
    assert during - before == pytest.approx(size, rel=0.05)
    assert after == pytest.approx(during, abs=0.05 * size)  # the peak stays until it is forgotten
    assert anew == pytest.approx(before, abs=0.05 * size)
