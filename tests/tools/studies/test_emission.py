"""The study of error against run time: its scenes, peers, archive and command, on few voxels."""

import json
import zipfile
from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from studies.benchmark import projectors
from studies.emission import archive, learned, methods, scenes, study
from studies.emission.course import PATIENCE, Course, best_of, falling

from tomo import load_scan, metrics
from tomo.operators import LinearSystem

GRID = scenes.TINY_GRID
ROUND = scenes.Emission("jet", "round puffs", "ring-6", "clean", 3)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("scenes")


@pytest.fixture(scope="module")
def jet(cache):
    return scenes.seen(ROUND, cache, GRID)


def test_kinds_noises_and_views_are_balanced():
    assert len(scenes.SCENES) == 12
    for counted in (
        Counter(one.kind for one in scenes.SCENES.values()),
        Counter(name.split("-")[1] for name in scenes.SCENES),
    ):
        assert set(counted.values()) == {3}
    assert set(Counter(one.noise for one in scenes.SCENES.values()).values()) == {4}


@pytest.mark.parametrize("family", ["averaged jet", "off-axis plume"])
def test_images_and_truth_agree_through_the_projector(family):
    scene = scenes.seen(replace(ROUND, family=family, rig="dome-3"), None, GRID)
    projector = LinearSystem.from_rig(scene.rig, GRID, skip=False).projector
    assert metrics.nrmse(projector @ scene.truth.ravel(), scene.images.ravel()) < 0.06
    assert scene.scores(scene.truth)["held_out_psnr"] > 30
    assert scene.scores(0.5 * scene.truth)["nrmse"] == pytest.approx(0.5)


def test_a_course_keeps_its_best_and_stops_when_nothing_is_better(jet):
    course = Course(jet.truth)
    assert not course.judge(0.9 * jet.truth)
    stops = [course.judge(0.5 * jet.truth) for _ in range(PATIENCE)]
    assert stops == [False] * (PATIENCE - 1) + [True]
    assert course.nrmse == pytest.approx(0.1, rel=1e-4)
    np.testing.assert_allclose(course.volume, 0.9 * jet.truth)


def test_the_curve_falls():
    assert falling([(3.0, 0.2), (1.0, 0.5), (2.0, 0.6)]) == [(1.0, 0.5), (3.0, 0.2)]


PEERS = [
    (methods.classic, {"method": "sart", "relaxation": 1.0}, 0.15),
    (methods.abel, {"reg": "nonneg"}, 0.05),
    (learned.fit, {"rate": 0.01, "frequency": 2.0}, 0.3),
    (learned.fit, {"rate": 0.03, "roughness": 1e-3}, 0.3),
]


@pytest.mark.parametrize(("run", "how", "least"), PEERS, ids=["sart", "abel", "neural", "planes"])
def test_a_peer_comes_near_the_truth(run, how, least, jet, monkeypatch):
    if run is methods.abel:
        pytest.importorskip("abel")
    monkeypatch.setattr(learned, "STEPS", 150)
    found = best_of(jet, run, [how])
    assert metrics.nrmse(found.volume, jet.truth) < least
    assert 0 < found.cpu_seconds <= found.tuning_seconds


RTK = [
    {"name": methods.SART, "sweeps": (5,), "Lambda": 1.0},
    {"name": methods.CG, "sweeps": (10,)},
    {"name": methods.TV, "sweeps": (3,), "GammaTV": 1e-3},
]


@pytest.mark.parametrize("how", RTK, ids=["sart", "cg", "tv"])
def test_rtk_takes_the_same_rays(how, jet):
    pytest.importorskip("itk")
    turned = replace(jet, images=jet.images[:, ::-1])
    right, wrong = (best_of(one, methods.by_rtk, [how]).curve[-1][1] for one in (jet, turned))
    assert right < 0.45
    assert wrong > 1.25 * right


def test_rtk_s_projectors_are_timed_on_the_rig_of_ours():
    pytest.importorskip("itk")
    ours = {row["what"]: row for row in projectors._on_the_fly(8, 3, 1) if row["threads"] == 1}
    found = projectors._joseph(8, 3, 1, list(ours.values()))
    assert len(found) == 2
    for row in found:
        other = ours[row["ratio_to"]]
        assert row["ratio"] == pytest.approx(other["seconds"] / row["seconds"])
        assert row["rays"] == other["rays"]


def test_an_archive_is_read_by_everyone_and_scored(cache, tmp_path):
    (name,) = study.SIZES["tiny"][1]
    archive.write_archive(tmp_path / "a.zip", [name], cache, GRID)
    with zipfile.ZipFile(tmp_path / "a.zip") as file:
        file.extractall(tmp_path)
    scan, scene = load_scan(tmp_path / name), scenes.seen(scenes.SCENES[name], cache, GRID)
    np.testing.assert_array_equal(np.stack(scan.images()), scene.images)
    (tmp_path / "volumes").mkdir()
    np.save(tmp_path / "volumes" / f"{name}.npy", scene.truth)
    (row,) = archive.scored(tmp_path / "volumes", [name], cache, GRID)
    assert row["nrmse"] == 0
    np.save(tmp_path / "volumes" / f"{name}.npy", scene.truth[1:])
    with pytest.raises(ValueError, match=f"{name}.npy: grid: found"):
        archive.scored(tmp_path / "volumes", [name], cache, GRID)


def test_the_command_goes_on_with_rows_that_are_missing(
    tmp_path, monkeypatch, quick_choice, as_given
):
    def in_this_process(function, jobs, _processes):
        return ((key, function(*job)) for key, job in jobs.items())

    monkeypatch.setattr(study, "at_work", in_this_process)
    monkeypatch.setattr(study, "warm_up", lambda: None)
    monkeypatch.setattr(methods, "Options", partial(methods.Options, **as_given))

    def run(*methods):
        study.run(tmp_path, method=methods, tiny=True)
        return json.loads((tmp_path / "emission.json").read_text())

    first = run("auto")["parts"]["scenes"]["tables"]["rows"]
    result = run("auto", "sart")
    tables = result["parts"]["scenes"]["tables"]
    assert tables["rows"][0] == first[0]
    assert [row["method"] for row in tables["rows"]] == ["auto", "sart"]
    assert {"commit", "machine"} <= set(result)
    (nearest,) = tables["nearest"]
    assert nearest["its_nrmse"] == min(row["nrmse"] for row in tables["rows"])
    assert (tmp_path / "emission" / "curves.png").is_file()
    assert "| auto | no |" in (tmp_path / "emission.md").read_text()
