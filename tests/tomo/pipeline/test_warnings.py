"""Warnings end with what to do; where a line of scan.yaml does it, that line works."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml

from tomo import Scan, load_scan
from tomo.operators.view_gains import Gains
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.advice import lines_for_gains
from tomo.scan import Corrections
from tomo.scan._schema import _Corrections
from tomo.scan.corrections import correction_line

pytestmark = pytest.mark.usefixtures("quick_choices")

DEEDS = {
    "add", "aim", "average", "calibrate", "check", "correct", "do", "enlarge", "expose", "give",
    "if", "leave", "let", "mask", "reconstruct", "run", "see", "subtract", "to", "use", "where",
}  # fmt: skip
"""Words that advice begins with."""


def lines_of(warnings):
    """Return the corrections that warnings write out, as the scan file's own reader takes them."""
    found = {}
    for text in re.findall(r"corrections: \{[^}]*\}?\}", "\n".join(warnings)):
        entry = yaml.safe_load(text)["corrections"]
        _Corrections.model_validate(entry)
        found |= entry
    return found


@pytest.fixture(scope="module")
def images(folder):
    scan = load_scan(folder)
    return dict(zip(scan.rig.names, scan.images(), strict=True))


@pytest.fixture(scope="module")
def taken(folder, images):
    """Return what makes a scan of other images, as integers of 12 bits."""
    scan = load_scan(folder)
    full = 1.25 * max(image.max() for image in images.values())

    def make(change=lambda name, image: image, corrections=None):
        recorded = {
            name: np.clip(np.round(4095 * change(name, image / full)), 0, 4095).astype(np.uint16)
            for name, image in images.items()
        }
        corrections = corrections or Corrections(bit_depth=12)
        return Scan.from_arrays(scan.rig, recorded, scan.grid, corrections=corrections)

    return make


FAST = Options(method="sirt", iterations=30)


def test_a_correction_line_is_yaml_whatever_the_cameras_are_called():
    values = {"cam03": 0.0157123, "left: {": 1.25, "7": 3e-5, "yes": 2}
    text = correction_line("dark", values)
    assert yaml.safe_load(text) == {
        "corrections": {"dark": {"cam03": 0.0157, "left: {": 1.25, "7": 3e-5, "yes": 2}}
    }
    assert correction_line("dark", 0.0157123) == "corrections: {dark: 0.0157}"


def test_the_line_for_a_dark_frame_left_in_removes_it(taken):
    scan = taken(lambda name, image: image + (0.03 if name == "cam03" else 0))
    found = reconstruct(scan, options=Options(uncertainty=0))
    lines = lines_of(found.warnings)
    assert lines["dark"] == pytest.approx({"cam03": 0.03}, rel=0.05)
    again = taken(
        lambda name, image: image + (0.03 if name == "cam03" else 0),
        Corrections(bit_depth=12, **lines),
    )
    assert "dark" not in lines_of(reconstruct(again, options=Options(uncertainty=0)).warnings)


def test_the_lines_for_gains_are_in_the_scans_own_numbers():
    error = np.full(3, 1e-4)
    gains = Gains(np.array([1.0, 1.25, 0.8]), np.array([0.0, 0.02, 0.0]), error, error)
    names = ("a", "b", "c")
    lines = [
        yaml.safe_load(one)["corrections"] for one in lines_for_gains(gains, names, Corrections())
    ]
    assert lines == [{"dark": {"b": 0.02}}, {"gain": {"b": 0.8, "c": 1.25}}]
    known = Corrections(dark=0.1, gain=2.0)
    lines = [yaml.safe_load(one)["corrections"] for one in lines_for_gains(gains, names, known)]
    assert lines == [{"dark": {"b": 0.11}}, {"gain": {"b": 1.6, "c": 2.5}}]
    # (raw - 0.11) * 1.6 = (b - 0.02) / 1.25 with b = (raw - 0.1) * 2
    assert pytest.approx(((0.5 - 0.1) * 2 - 0.02) / 1.25) == (0.5 - 0.11) * 1.6


def test_one_number_stands_for_a_dark_level_that_all_cameras_share():
    error = np.full(3, 1e-4)
    gains = Gains(np.ones(3), np.array([0.0201, 0.02, 0.0199]), error, error)
    assert lines_for_gains(gains, "abc", Corrections()) == ("corrections: {dark: 0.02}",)
    unsure = replace(gains, offset_error=np.full(3, 0.01))
    assert lines_for_gains(unsure, "abc", Corrections()) == ()


def test_saturated_pixels_are_left_out_with_a_line(taken):
    scan = taken(lambda name, image: image * (2 if name == "cam01" else 1))
    found = reconstruct(scan, options=FAST)
    (warning,) = [line for line in found.warnings if line.startswith("saturation: ")]
    assert "camera cam01's bright pixels are at full scale" in warning
    assert lines_of([warning]) == {"saturation": {"cam01": 0.98}}
    view = next(view for view in found.views if view.name == "cam01")
    assert 0 < np.count_nonzero(~view.mask) < 0.5 * view.mask.size
    plain = reconstruct(taken(), options=FAST)
    assert not [line for line in plain.warnings if line.startswith("saturation: ")]


CHANGES = {
    "background": lambda name, image: image + 0.05,
    "saturated": lambda name, image: 3 * image,
    "unequal": lambda name, image: image * (0.7 if name == "cam02" else 1),
    "mirrored": lambda name, image: image[:, ::-1] if name == "cam04" else image,
    "dark": lambda name, image: 0 * image,
}


@pytest.mark.parametrize("change", CHANGES)
def test_every_warning_ends_with_what_to_do(taken, change):
    found = reconstruct(taken(CHANGES[change]))
    lines_of(found.warnings)
    for warning in found.warnings:
        sentences = re.split(r"[.:;] |, or ", warning)
        assert any(one.split()[0].lower() in DEEDS for one in sentences[1:]), warning
