"""Settings of both networks, and the files that hold them."""

from dataclasses import asdict, fields

import numpy as np
import pytest
import torch
import yaml

from tomo.wernet import PaperSettings, WernetSettings, load_settings, settings_names, wernet_paper
from tomo.wernet.settings import Learning

KINDS = (PaperSettings, WernetSettings)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_all_fields_gives_the_settings_back(tmp_path, kind):
    changed = kind(blocks=4, channels=7, rays_per_step=11)
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(asdict(changed)))
    assert load_settings(tmp_path / "own.yaml", kind) == changed != kind()


def test_a_field_left_out_keeps_its_default_and_1e_3_is_a_number(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("penalty: 1e-4\nsteps: 3\n")
    assert load_settings(path, WernetSettings) == WernetSettings(penalty=1e-4, steps=3)
    path.write_text("last_bias: null\n")
    assert load_settings(path, PaperSettings) == PaperSettings(last_bias=None)


def test_the_settings_that_come_along_are_the_working_ones_and_the_text_s():
    assert settings_names() == ("paper", "paper-text")
    assert load_settings("paper", PaperSettings) == PaperSettings()
    text = load_settings("paper-text", PaperSettings)
    assert (text.variant, text.inputs, text.last_bias) == ("batch-norm", "absolute", None)
    assert (text.encoder_learning_rate, text.voxel_learning_rate) == (0.0005, 0.01)
    assert text.rays_per_step == 32 * 100


@pytest.mark.parametrize(
    ("kind", "line", "words"),
    [
        (PaperSettings, "layout: packed", "'layout': found a field that PaperSettings has not"),
        (PaperSettings, "inputs: polar", "inputs: found 'polar', expected one of absolute, rel"),
        (PaperSettings, "inputs: [relative]", "inputs: found .'relative'., expected one of"),
        (PaperSettings, "variant: 3", "variant: found 3, expected one of no-bias, bias-mask"),
        (PaperSettings, "loss: huber", "loss: found 'huber', expected one of squared, absolute"),
        (PaperSettings, "blocks: 0", "blocks: found 0, expected a whole number from 1 to 64"),
        (PaperSettings, "blocks: true", "blocks: found True, expected a whole number"),
        (PaperSettings, "channels: 1000000000", "channels: found 1000000000, expected a whole"),
        (PaperSettings, "halve_every: 2.5", "halve_every: found 2.5, expected a whole number >="),
        (PaperSettings, "rays_per_step: many", "rays_per_step: found 'many', expected a whole"),
        (PaperSettings, "last_bias: .inf", "last_bias: found inf, expected a finite number or n"),
        (PaperSettings, "normalise_gradient: 1", "normalise_gradient: found 1, expected true or"),
        (PaperSettings, "voxel_start: .nan", "voxel_start: found nan, expected a finite number"),
        (PaperSettings, "voxel_learning_rate: -1", "voxel_learning_rate: found -1, expected a fi"),
        (PaperSettings, "encoder_learning_rate: x", "encoder_learning_rate: found 'x', expected"),
        (WernetSettings, "variant: no-bias", "'variant': found a field that WernetSettings has n"),
        (WernetSettings, "steps: 0", "steps: found 0, expected a whole number >= 1"),
        (WernetSettings, "penalty: nan", "penalty: found nan, expected a finite number >= 0"),
        (WernetSettings, "learning_rate:", "learning_rate: found nothing, expected a finite"),
        (WernetSettings, "last_rate: 1.5", "last_rate: found 1.5, expected a number from 0 to 1"),
        (WernetSettings, "- 1", "found a list, expected a YAML mapping"),
        (WernetSettings, "", "found an empty file"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_file_and_field(tmp_path, kind, line, words):
    path = tmp_path / "own.yaml"
    path.write_text(line)
    with pytest.raises(ValueError, match=words) as caught:
        load_settings(path, kind)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_name_that_is_neither_a_file_nor_known_is_refused():
    with pytest.raises(FileNotFoundError, match=r"nothing: no such .* are paper, paper-text"):
        load_settings("nothing", PaperSettings)


@pytest.mark.parametrize(
    "change",
    [
        {"inputs": "absolute"}, {"variant": "no-bias"}, {"blocks": 1}, {"channels": 4},
        {"last_bias": None}, {"normalise_gradient": False}, {"loss": "absolute"},
        {"voxel_start": 0.5}, {"voxel_learning_rate": 0.02}, {"encoder_learning_rate": 0.001},
        {"halve_every": 1}, {"rays_per_step": 400},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_every_setting_of_the_paper_s_network_changes_the_volume(scene, change):
    one = scene()
    plain, changed = (
        wernet_paper(one.projector, one.measured, iterations=2, settings=PaperSettings(**how))
        for how in ({}, change)
    )
    assert np.isfinite(changed.volume).all()
    assert not np.array_equal(plain.volume, changed.volume)
    assert changed.settings.items() >= change.items()


def test_the_changes_above_are_of_all_fields():
    marks = test_every_setting_of_the_paper_s_network_changes_the_volume.pytestmark
    changes = [change for mark in marks for change in mark.args[1]]
    assert {name for change in changes for name in change} == {
        f.name for f in fields(PaperSettings)
    }


def test_the_last_bias_starts_where_it_is_asked_to(scene):
    one = scene()
    for asked in (0.5, 2.0):
        settings = PaperSettings(last_bias=asked, encoder_learning_rate=0.0)
        found = wernet_paper(one.projector, one.measured, iterations=1, settings=settings)
        assert torch.equal(found.encoder.last.bias, torch.tensor([asked]))


@pytest.mark.parametrize(
    ("method", "content", "words"),
    [
        ("wernet", "freeze_encoder: true", "freeze_encoder: found no encoder to freeze"),
        ("wernet", "encoder: 3", "encoder: found 3, expected a path"),
        ("wernet", "freeze_encoder: 1\nencoder: e.pt", "freeze_encoder: found 1, expected true"),
        ("wernet", "resume: true", "'resume': found a field that WernetSettings has not"),
        ("wernet-paper", "resume: true", "resume: found no checkpoint to go on from"),
        ("wernet-paper", "encodr: e.pt", "'encodr': found a field .* did you mean encoder"),
    ],
)
def test_files_of_a_training_that_contradict_each_other(tmp_path, method, content, words):
    (tmp_path / "own.yaml").write_text(content)
    with pytest.raises(ValueError, match=f"own.yaml: {words}"):
        Learning.load(tmp_path / "own.yaml", method)


def test_paths_are_those_beside_the_settings(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("channels: 4\nencoder: old.pt\nsave_encoder: /new.pt\ncheckpoint: c/d.pt\n")
    found = Learning.load(path, "wernet-paper")
    assert found.settings == PaperSettings(channels=4)
    assert found.files.save_encoder == "/new.pt"
    assert found.arguments == {
        "settings": found.settings,
        "encoder": str(tmp_path / "old.pt"),
        "checkpoint": str(tmp_path / "c/d.pt"),
        "freeze_encoder": False,
        "resume": False,
    }
