import json

import numpy as np
import pytest

from rigs import Camera, Distortion, Rig, formats, load_rig, preset, save_rig


@pytest.fixture
def rig(tmp_path):
    brown = Distortion("brown", (-0.2, 0.05, 0.001, -0.002, 0.01))
    K = [[800, 0, 320], [0, 810, 240], [0, 0, 1]]
    rig = Rig(
        (
            Camera("left", (640, 480), K, brown, t=[0.1, 0.2, 3.0]),
            Camera("right", (640, 480), K, t=[-0.1, 0.2, 3.0]),
        ),
        "m",
    )
    save_rig(rig, tmp_path / "rig.yaml")
    return rig


def seen(rig):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))
    return [camera.project(points)[0] for camera in rig]


@pytest.mark.parametrize("name", ["other.yml", "transforms.json"])
def test_there_and_back(run_tool, tmp_path, rig, name):
    done = run_tool("convert_rig", tmp_path / "rig.yaml", tmp_path / "there" / name, "--json")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["cameras"] == ["left", "right"]
    assert report["format"] == "emission_rig"
    done = run_tool("convert_rig", tmp_path / "there" / name, tmp_path / "back.yaml")
    assert done.exit_code == 0, done.stderr
    back = load_rig(tmp_path / "back.yaml")
    for found, expected in zip(seen(back), seen(rig), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_lengths_are_converted_or_named(run_tool, tmp_path, rig):
    given = (tmp_path / "rig.yaml", tmp_path / "mm.yaml")
    done = run_tool("convert_rig", *given, "--length-unit", "mm")
    assert done.exit_code == 0, done.stderr
    scaled = load_rig(tmp_path / "mm.yaml")
    np.testing.assert_allclose(scaled["left"].t, [100, 200, 3000])
    formats.save(rig, tmp_path / "model", "colmap")  # which knows no unit
    done = run_tool("convert_rig", tmp_path / "model", tmp_path / "x.yaml", "--length-unit", "m")
    assert done.exit_code == 0, done.stderr
    assert load_rig(tmp_path / "x.yaml").length_unit == "m"
    np.testing.assert_allclose(load_rig(tmp_path / "x.yaml")["left"].t, [0.1, 0.2, 3.0])


def test_sizes_can_be_given(run_tool, tmp_path):
    words = ["1 0 0 0 1 0 0 0 1 0 0 5", "800 0 32 0 800 24 0 0 1"]
    (tmp_path / "a_par.txt").write_text(f"1\na.png {words[1]} {words[0]}\n")
    arguments = ("convert_rig", tmp_path / "a_par.txt", tmp_path / "a.yaml")
    done = run_tool(*arguments)
    assert done.exit_code == 2
    assert "camera a: image_size: missing" in done.stderr
    done = run_tool(*arguments, "--image-size", "64x48")
    assert done.exit_code == 0, done.stderr
    assert load_rig(tmp_path / "a.yaml")["a"].image_size == (64, 48)


def test_the_help_names_every_format(run_tool):
    done = run_tool("convert_rig", "--help")
    assert done.exit_code == 0
    for name in formats.FORMATS:
        assert name in done.stdout


def test_other_commands_read_foreign_rigs(run_tool, tmp_path):
    formats.save(preset("paper11_33deg"), tmp_path / "rig.yml")
    done = run_tool("visualize_rig", tmp_path / "rig.yml", "-o", tmp_path / "rig.glb", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["cameras"] == list(preset("paper11_33deg").names)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rig.yaml", "x.astra.json"), "x.astra.json: camera left: distortion: found model brown"),
        (("rig.yaml", "x.foo"), "x.foo: its ending names no format, expected --to with one of"),
        (
            ("rig.yaml", "x", "--to", "kalibr"),
            "format: found 'kalibr', expected one written",
        ),
        (
            ("rig.yaml", "x.yml", "--from", "rtk"),
            "format: found 'rtk', expected one read",
        ),
        (("rig.yaml", "x.yml", "--image-size", "9"), "--image-size: found '9', expected pixels"),
        (
            ("rig.yaml", "x.yml", "--image-size", "64x48"),
            "camera left: image_size: found (64,",
        ),
        (
            ("note.txt", "x.yml"),
            "note.txt: found none of the rig formats, expected a file",
        ),
    ],
)
def test_bad_input_is_one_line(refused, tmp_path, rig, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "note.txt").write_text("no rig\n")
    assert words in refused("convert_rig", *arguments)
