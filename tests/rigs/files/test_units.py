"""Rigs taken into another length unit."""

from dataclasses import replace

import pytest

from rigs import arc, formats, load, save_rig
from rigs.check import check_points
from rigs.check.rig_check import calibrated_ray_miss
from rigs.files.rig_yaml import load_scene
from rigs.files.units import in_unit

SUMMARY = {
    "length_unit": "mm",
    "rms_px": 0.1,
    "frames": 12,
    "ray_miss_predicted": 0.002,
    "ray_miss_between_halves": None,
    "pixel_footprint": 0.32,
    "assessment": "good: rays miss each other by 0.002 mm RMS",
    "cameras": {"cam00": {"ray_miss": 0.003, "rms_px": 0.2, "depth_range": [400.0, 600.0]}},
    "target_poses": [{"frame": "a", "camera": "cam00", "corners": [[1.0, 2, 500.0]] * 3}],
    "windows": {"pane": {"thickness": 10.0, "thickness_error": 0.1, "turned_degrees": 0.2}},
    "refined_from_images": {"cameras": {"cam00": {"position_right_down_forward": [1.0, 0, 3]}}},
}


def a_rig(**changes):
    rig = arc(3, distance=500.0, span_degrees=90, image_size=(120, 120), footprint=0.25)
    return replace(rig, length_unit="mm", **changes)


def test_lengths_of_the_calibration_follow():
    rig = a_rig(calibration=SUMMARY)
    metres = in_unit(rig, "m")
    found = metres.calibration
    assert calibrated_ray_miss(metres) == pytest.approx(2e-6)
    assert calibrated_ray_miss(metres, "cam00") == pytest.approx(3e-6)
    assert found["cameras"]["cam00"]["depth_range"] == pytest.approx([0.4, 0.6])
    assert found["target_poses"][0]["corners"][2] == pytest.approx([0.001, 0.002, 0.5])
    assert found["windows"]["pane"] == pytest.approx(
        {"thickness": 0.01, "thickness_error": 1e-4, "turned_degrees": 0.2}
    )
    moved = found["refined_from_images"]["cameras"]["cam00"]["position_right_down_forward"]
    assert moved == pytest.approx([0.001, 0, 0.003])
    for key in ("rms_px", "frames", "ray_miss_between_halves", "assessment"):
        assert found[key] == SUMMARY[key]
    assert found["cameras"]["cam00"]["rms_px"] == 0.2
    assert rig.calibration == SUMMARY
    points = [[x, y, 0.0] for x in (-5.0, 5.0) for y in (-5.0, 5.0)]
    in_metres = [[value / 1000 for value in point] for point in points]
    one = check_points(rig, points, (10, 10, 1), 0.5)
    other = check_points(metres, in_metres, (0.01, 0.01, 0.001), 0.0005)
    assert other.ray_miss_from == "calibration"
    assert other.ray_miss / other.voxel == pytest.approx(one.ray_miss / one.voxel)


def test_a_calibration_without_a_unit_counts_in_the_rig_s():
    summary = {key: value for key, value in SUMMARY.items() if key != "length_unit"}
    assert calibrated_ray_miss(in_unit(a_rig(calibration=summary), "m")) == pytest.approx(2e-6)


def test_unknown_units_are_taken_to_be_the_one_asked_for():
    unknown = replace(a_rig(calibration=SUMMARY | {"length_unit": "unit"}), length_unit="unit")
    assert calibrated_ray_miss(in_unit(unknown, "m")) == 0.002


def test_a_scene_is_taken_from_a_file_in_another_unit(tmp_path):
    pane = (
        "{name: pane, type: window, point: [0, 0, 20], normal: [0, 0, 1], thickness: 1, "
        "index: 1.5, size: 16}"
    )
    (tmp_path / "scene.yaml").write_text(f"length_unit: cm\nscene: {{solids: [{pane}]}}\n")
    (window,) = load_scene(tmp_path / "scene.yaml", "mm").solids
    assert window.thickness == pytest.approx(10)
    assert window.point[2] == pytest.approx(200)
    (tmp_path / "scene.yaml").write_text(f"length_unit: unit\nscene: {{solids: [{pane}]}}\n")
    assert load_scene(tmp_path / "scene.yaml", "mm").solids[0].thickness == 1  # taken as it is


def test_a_folder_of_two_rigs_is_no_rig(tmp_path):
    save_rig(a_rig(), tmp_path / "rig.yaml")
    assert load(tmp_path) == a_rig()
    formats.save(a_rig(), tmp_path / "transforms.json")
    with pytest.raises(ValueError, match=r"transforms\.json and rig\.yaml, expected one"):
        load(tmp_path)
