"""The runs of known scenes: what is kept, what counts as named, and what is refused."""

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from studies.scenes import cameras, design, learned, oracle, parts, patches, trial
from studies.scenes.faults import FAULTS
from studies.scenes.recipe import HALVES, Recipe
from studies.scenes.scene import KnownScene
from studies.scenes.trial import Trials

import rigs
from rigs.layouts import ring
from tomo import LinearSystem, VoxelGrid

RECIPE = Recipe("settle", "tilted cone", "ring-5", "clean", 0)


@pytest.fixture
def rows(monkeypatch, in_this_process):
    """Return what was run, and let scenes come to what their numbers of views say."""
    ran = []

    def row_of(recipe, cache, options, constants, *, oracle):
        ran.append((recipe, dict(options), dict(constants), oracle))
        return {
            **vars(recipe), "views": recipe.views, "scene": recipe.name, "seconds": 1.0,
            "nrmse": 0.1 * (1 + bool(recipe.fault)) * (1 + bool(constants)),
            "cosine_distance": 0.01, "cpu_seconds": 2.0, "learned": "method" in options,
            "of_best": 1 + recipe.views / 10, "cosine_of_best": 1.0,
        }  # fmt: skip

    monkeypatch.setattr(trial, "row_of", row_of)
    return ran


@pytest.fixture
def trials(tmp_path):
    return Trials(tmp_path / "cache", tmp_path / "rows")


def silent(done, total, name):
    pass


def test_an_interrupted_run_goes_on_where_it_is_asked_to(rows, trials):
    first = trials.run([RECIPE], silent)
    again = replace(trials, resume=True)
    assert again.run([RECIPE, replace(RECIPE, seed=1)], silent)[0] == first[0]
    assert len(rows) == 2
    trials.run([RECIPE], silent)
    replace(again, constants={"tomo.x": 2}).run([RECIPE], silent)
    assert [constants for _, _, constants, _ in rows] == [{}, {}, {}, {"tomo.x": 2}]


def test_errors_are_summed_up_by_family_views_and_noise(rows, trials):
    tables = parts.accuracy(trials, "settle", quick=True, progress=silent)
    assert all(oracle for *_, oracle in rows)
    assert tables["overall"][0]["scenes"] == len(design.FAMILIES["settle"])
    assert sum(row["scenes"] for row in tables["by_noise"]) == len(design.FAMILIES["settle"])
    for row in tables["by_views"]:
        assert row["of_best"] == pytest.approx(1 + row["views"] / 10)
    ratios = [row["of_best"] for row in tables["scenes"]]
    assert ratios == sorted(ratios, reverse=True)
    assert tables["overall"][0]["worst"] == ratios[0]


def test_learned_weights_are_compared_on_scenes_of_the_same_flame(rows, trials):
    tables = learned.learned(trials, "settle", quick=False, progress=silent)
    recipes = learned.recipes("settle")
    assert len(recipes) == len(tables["nrmse"]) == len(tables["cpu_seconds"]) == 7
    assert {one.faultless for one in recipes} == {recipes[0]}
    assert recipes[0].grid.shape == (36, 48, 36)
    assert recipes[0].views == 16
    faultless, cloud, *_ = tables["nrmse"]
    assert (faultless["times"], cloud["times"], cloud["of_default"]) == (1, pytest.approx(2), 1)
    assert cloud["kept"] is True
    assert {options["uncertainty"] for _, options, *_ in rows} == {0}


def test_constants_are_set_for_a_while_wherever_they_were_imported():
    methods, solve = map(import_module, ("tomo.pipeline.methods", "tomo.pipeline.solve"))
    before = methods.AUTO
    with patches.patched(patches.parsed(["tomo.pipeline.methods.AUTO=other"], "--set")):
        assert methods.AUTO == solve.AUTO == "other"
    assert methods.AUTO == solve.AUTO == before
    smart, learned = map(import_module, ("tomo.solvers.smart", "tomo.pipeline.learned_weights"))
    assert smart.FAINTEST == learned.FAINTEST == 1e-3
    with patches.patched({"tomo.solvers.smart.FAINTEST": 0.4}):
        assert (smart.FAINTEST, learned.FAINTEST) == (0.4, 1e-3)
    with (
        pytest.raises(ValueError, match=r"--set: found 'tomo\.solvers\.nothing\.X'"),
        patches.patched({"tomo.solvers.nothing.X": 1}),
    ):
        pass


def test_designs_meet_every_family_rig_and_noise():
    kinds = set(cameras.KINDS) - {"narrow"}
    for half in HALVES:
        for recipes in (design.faultless(half), design.alarms(half)):
            assert {r.family for r in recipes} == set(design.FAMILIES[half])
            assert {r.views for r in recipes} == {5, 6, 8, 12, 24, 33}
            assert {r.rig.rpartition("-")[0] for r in recipes} == kinds
            assert len({r.noise for r in recipes}) == 3
            assert len(set(recipes)) == len(recipes)
        assert len(set(design.faulty(half))) == 3 * design.PAIRS[half] * len(FAULTS)
        special = {r.family for r in design.special(half)}
        assert special | set(design.FAMILIES[half]) == set(HALVES[half])
        every = design.everything(half)
        assert len(set(every)) == len(every)
        assert set(every) >= {*design.faulty(half), *design.special(half), *design.alarms(half)}
    assert len(design.faultless("report")) >= 60
    assert len(design.alarms("report")) == 200


def test_a_sample_is_stratified_and_can_end_anywhere():
    for half in HALVES:
        few, more = design.sample(half), design.sample(half, 2)
        assert set(few) <= set(more) <= set(design.everything(half))
        assert {r.fault for r in few} == {"", *FAULTS}
        assert {r.family for r in few} == set(HALVES[half])
        assert all(few.index(r.faultless) <= number for number, r in enumerate(few))
        for fault in FAULTS:
            assert len({r.size for r in more if r.fault == fault}) == 2


def test_the_best_of_the_list_is_stopped_by_the_truth(monkeypatch, tmp_path):
    grid = VoxelGrid((8, 8, 8), 1.0)
    rig = ring(5, image_size=(14, 14), footprint=0.9)
    truth = np.zeros(grid.shape, np.float32)
    truth[3:6, 2:6, 3:5] = 0.05
    system = LinearSystem.from_rig(rig, grid, skip=False)
    flat = system.projector @ truth.ravel()
    images = dict(zip(rig.names, flat.reshape(5, 14, 14), strict=True))
    scene = KnownScene(RECIPE, rigs.Rig(tuple(rig)), grid, images, truth)
    monkeypatch.setattr(oracle, "PLAIN", {"mlem": 40, "art": 5})
    monkeypatch.setattr(oracle, "STARTS", {"tikhonov": 1e-3})
    best = oracle.best_of(scene, tmp_path)
    assert best.nrmse == min(best.by_method.values())
    assert set(best.by_method) == {
        "mlem, voxel", "art, voxel", "tikhonov, voxel", "mlem, linear", "tikhonov, linear",
    }  # fmt: skip
    assert best.nrmse < 0.5
    assert oracle.best_of(scene, tmp_path) == best
    (path,) = tmp_path.iterdir()
    assert json.loads(path.read_text())["name"] == best.name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--half", "all", "--part", "faults"), "--half: found 'all', expected one of settle"),
        (("--half", "settle", "--part", "x"), "--part: found 'x', expected one of judge"),
        (("--set", "tomo.x=1"), "--set: found part judge, expected another"),
        (("--half", "settle", "--part", "ablation"), "expected --set or --option"),
        (("--half", "settle", "--part", "ablation", "--set", "x"), "--set: found 'x'"),
        (("--half", "settle", "--part", "ablation", "--option", "x=1"), "options: found 'x'"),
    ],
)
def test_bad_input_is_one_line(run_tool, tmp_path, arguments, words):
    done = run_tool("scenes", *arguments, "-o", str(tmp_path))
    assert done.exit_code == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert words in line


@pytest.mark.parametrize("half", HALVES)
def test_intervals_are_measured_with_a_camera_out_in_every_field_of_a_half(half):
    found = parts.camera_out(half)
    assert {one.family for one in found} == set(design.FAULTY[half][0])
    assert len(set(found)) == len(found) == 2 * len(parts.camera_out(half, quick=True))


@pytest.mark.parametrize("half", HALVES)
def test_a_quick_measure_of_intervals_has_fine_detail_and_faults(half):
    found = parts.sample(half)
    assert len(set(found)) == len(found) == 20
    assert {one.family for one in found} == set(HALVES[half])
    faulty = [one for one in found if one.fault]
    assert len(faulty) == len(design.FAULTY[half][0])
    assert sum(one.family in parts.FINE for one in found if not one.fault) == 4
