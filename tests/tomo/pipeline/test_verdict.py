"""The verdict: green, amber or red from the figures of report.json, by one table of rules."""

import copy
from dataclasses import replace

import numpy as np
import pytest

import phantoms
import tomo
from rigs.layouts import ring
from tomo.inference.finding import WORDS, Finding
from tomo.pipeline.verdict import AMBER, GREEN, LEVELS, RED, RULES, judge, rules_that_apply

GOOD = {
    "answer": {"verdict": "partly explained", "beyond_noise": 0.01, "beyond_noise_of_all": 0.005},
    "views": {
        f"cam{n:02d}": {"beyond_noise": 0.01, "held_out": False, "excluded": False}
        for n in range(8)
    },
    "screening": {"excluded": []},
    "findings": [],
    "carving": {"light_carved_away": 0.0},
    "uncertainty": {
        "voxels": {
            "median_views": 8.0,
            "emitting_by_views": {"8": 900},
            "resolved_wavelength": {"of_length": 0.5, "worst_direction_in_words": "x"},
        },
        "standard_deviation": {"relative": 0.01},
        "intervals": {"voxels": {"relative": 0.05}},
    },
}


def changed(**parts):
    """Return the good report with parts of it set, by paths whose keys ``__`` separates."""
    report = copy.deepcopy(GOOD)
    for path, value in parts.items():
        *keys, last = path.split("__")
        inner = report
        for key in keys:
            inner = inner.setdefault(key, {})
        inner[last] = value
    return report


def reporting(effect, camera=None, size=0.0, **how):
    """Return the good report with one finding."""
    return changed(findings=[Finding(effect, camera, size, **how).report()])


def test_nothing_wrong_is_green_and_says_why_and_what_to_do():
    found = judge(GOOD)
    assert found.level == GREEN
    assert any("explains the images of all 8 cameras" in one for one in found.reasons)
    assert "--hold-out cam00" in found.next[0]
    assert found.sentence.startswith("Green, use it: the volume explains")


FEW = [f"cam{n:02d}" for n in range(4)]


CASES = [
    (changed(answer__beyond_noise=0.04), RED, "more than the 3.0%"),
    (changed(answer__beyond_noise=0.025), AMBER, "2.5% of an image"),
    (changed(answer__beyond_noise=0.02), GREEN, "2.0% of an image"),
    (changed(answer__beyond_noise=0.025, uncertainty__intervals__voxels__growth=2.0), RED, "1.5%"),
    (changed(answer__beyond_noise=0.3, uncertainty__intervals=None), AMBER, "at least 30%"),
    (changed(answer__beyond_noise=0.6, uncertainty__intervals=None), RED, "at least 60%"),
    (changed(answer__verdict="not known", answer__beyond_noise=None), RED, "no image has light"),
    (reporting("mirrored", "cam02", other="upside down"), GREEN, "02: its image is turned over"),
    (reporting("order", "cam02", other="cam03"), GREEN, "02: its image is that of camera cam03"),
    (reporting("same image", "cam02", other="cam03"), AMBER, "of camera cam03 too"),
    (reporting("saturation", "cam02", 0.9), AMBER, "cut off at 0.9"),
    (reporting("below zero", "cam02", 0.05, unit="%", corrected=False), AMBER, "5.0 %"),
    (changed(findings=[Finding("background", "cam05", 0.1, unit="%", corrected=False).report()],
             views__cam05={"held_out": True, "beyond_noise": 0.02}), GREEN, "of 10.0 %"),
    (reporting("bad pixels", "cam02", 0.01, unit="%"), GREEN, "1.0 %"),
    (reporting("dark", "cam02"), AMBER, "cam02: no light"),
    (reporting("hidden", "cam02", 0.3, unit="%"), AMBER, "30.0 % of the pixels"),
    (reporting("outside", size=0.3, unit="%"), AMBER, "30.0 % of the light comes from outside"),
    (reporting("absorption", size=0.2), AMBER, "optical depth 0.2"),
    (reporting("pose", "cam03", 3.0, unit="px", corrected=False), AMBER, "3.0 px"),
    (reporting("pose", "cam03", 3.0, unit="px"), GREEN, "3.0 px beside where the rig says: corr"),
    (reporting("gain", "cam03", 0.4, unit="%"), GREEN, "gain 40.0 % off"),
    (reporting("gain", "cam03", 0.4, unit="%", corrected=False), AMBER, "not corrected"),
    (reporting("fall-off", size=0.4, unit="%"), GREEN, "all cameras: images darken"),
    (changed(refinement={"accepted": True, "cameras": {"cam01": {}}}), AMBER, "corrected"),
    (changed(views__cam02__status="nominal"), AMBER, "positions of 1 camera are nominal"),
    (changed(views__cam02__status="calibrated", views__cam03__status="virtual"), GREEN, "all 8"),
    (changed(carving__light_carved_away=0.02), AMBER, "2.0% of the light"),
    (changed(uncertainty__intervals__voxels__relative=0.3), AMBER, "18%"),
    (changed(uncertainty__intervals__voxels__relative=1.0), RED, "61%"),
    (changed(uncertainty__voxels__resolved_wavelength__of_length=1.0), AMBER, "x is a guess"),
    (changed(uncertainty__voxels__resolved_wavelength__of_length=1.41), RED, "shape along x"),
    (changed(uncertainty__voxels__resolved_wavelength__of_length=None), RED, "shape along x"),
    (changed(uncertainty__voxels__emitting_by_views={"1": 90, "8": 810}), AMBER, "10% of the vox"),
    (changed(views={name: GOOD["views"][name] for name in FEW}), AMBER,
     "a wrong one cannot be found"),
    (changed(views={name: GOOD["views"][name] for name in FEW[:2]}), RED, "volume: 2 cameras"),
    (changed(uncertainty__intervals=None), AMBER, "was not measured"),
    (changed(views__cam05={"held_out": True, "beyond_noise": 0.2}), RED, "is not predicted"),
    (changed(views__cam05={"held_out": True, "beyond_noise": 0.2},
             uncertainty__intervals__voxels__relative=0.4), AMBER, "predicted in part"),
    (changed(views__cam05={"held_out": True, "beyond_noise": 0.2},
             held_out__cam05__fitted__beyond_noise=0.02), GREEN, "cam05, which was"),
    (changed(views__cam05={"held_out": True, "beyond_noise": 0.02}), GREEN, "cam05, which was"),
]  # fmt: skip


@pytest.mark.parametrize(("report", "level", "words"), CASES)
def test_each_finding_has_its_level_and_its_reason(report, level, words):
    verdict = judge(report)
    assert verdict.level == level, verdict
    assert any(words in one for one in verdict.reasons), verdict.reasons
    assert verdict.next
    assert len(set(verdict.next)) == len(verdict.next)


def test_the_gravest_reason_comes_first_and_steps_in_the_order_of_mending():
    report = reporting("same image", "cam03", other="cam02")
    report["answer"] = {"verdict": "not explained", "beyond_noise": 0.3}
    verdict = judge(report)
    assert verdict.level == RED
    assert "expected to be wrong by more" in verdict.reasons[0]
    assert verdict.next[0] == "Check the files of cameras cam03 and cam02"
    assert verdict.sentence.endswith("and 1 more reason.")


def test_every_rule_is_met_by_a_case_and_says_what_to_do():
    met = {rule for report, *_ in CASES for rule, _ in rules_that_apply(report)}
    assert [rule for rule in RULES if rule not in met] == []
    assert all(rule.level in LEVELS and rule.step for rule in RULES)


@pytest.mark.parametrize("effect", WORDS)
def test_a_finding_is_said_once_with_what_to_do(effect):
    one = Finding(effect, "cam02", 0.1, other="cam03")
    verdict = judge(changed(findings=[one.report()]))
    assert one.step in verdict.next
    (reason,) = [line for line in verdict.reasons if line in one.report()["sentence"]]
    assert f"{reason}. {one.step}" == one.report()["sentence"]


def test_cameras_with_the_same_fault_share_a_sentence():
    many = [Finding("gain", f"cam{n:02d}", 0.01 * n, unit="%").report() for n in range(1, 8)]
    two = [Finding("pose", f"cam{n:02d}", n, unit="px").report() for n in (1, 2)]
    reasons = judge(changed(findings=[*many, *two])).reasons
    (gains,) = [one for one in reasons if "gain" in one]
    assert gains.startswith("7 cameras, cam07 most: gain up to 7.0 %")
    (poses,) = [one for one in reasons if "pose" in one]
    assert poses.startswith("cameras cam01, cam02: ")


def test_a_finding_is_read_back_from_its_report():
    one = Finding("pose", "cam03", 3.0, 0.04, "px", 2.5, consequence=0.2)
    assert Finding.of(one.report()) == one
    assert "3.0 ± 0.04 px" in one.report()["sentence"]


GRID = tomo.VoxelGrid((12, 14, 12), 1.0)
FLAME = phantoms.GaussianBlobs(
    [(1.0, -2.0, 0.5), (-2.0, 2.0, 1.0), (1.5, 2.5, -2.0)], [1.3, 1.1, 1.0], [1.0, 0.8, 0.9]
)


def seen_by(count, shifts=(), shrink=1, **options):
    """Reconstruct a flame seen by cameras of which the first look aside, in pixels."""
    rig = ring(
        count, distance=200.0, image_size=(32, 36), footprint=0.55,
        pitch_degrees=[(-8.0, 15.0)[n % 2] for n in range(count)],
    )  # fmt: skip
    scan = tomo.simulate(rig, FLAME, GRID, supersample=2, noise=0.01, seed=1)
    moved = [one.shifted(*shift) for one, shift in zip(rig, shifts, strict=False)]
    given = replace(rig, cameras=(*moved, *rig.cameras[len(moved) :]))
    scan = replace(scan, rig=given).scaled(shrink)
    return tomo.reconstruct(scan, options=tomo.Options(**options))


def test_exact_cameras_in_sufficient_number_are_green():
    found = seen_by(8).verdict
    assert found.level == GREEN, found
    assert found.report()["sentence"] == found.sentence


def test_three_views_are_amber():
    found = seen_by(3, uncertainty=0).verdict
    assert found.level == AMBER, found
    assert "is a guess" in found.reasons[0]


def test_a_wrong_rig_is_red(quick_solve):
    shifts = np.random.default_rng(0).uniform(-7, 7, (6, 2))
    poses = {"method": "mlem", "fit_gain": False, "uncertainty": 0}
    assert seen_by(6, shifts, shrink=2, **poses).verdict.level == RED


def test_refined_nominal_cameras_are_said_once_and_stay_amber_with_the_refined_rig():
    """Images that were explained by moving the cameras do not prove where these are."""
    views = {name: view | {"status": "nominal"} for name, view in GOOD["views"].items()}
    refined = judge(changed(views=views, refinement={"accepted": True, "cameras": dict(views)}))
    again = judge(changed(views=views))
    assert refined.level == again.level == AMBER
    assert [one for one in refined.reasons if "positions" in one] == [
        "the positions of 8 cameras were corrected from the images"
    ]
    assert "8 cameras are nominal" in again.reasons[0]
