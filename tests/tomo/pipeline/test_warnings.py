"""Warnings end with what to do; where a line of scan.yaml does it, that line works."""

import re
from ast import literal_eval
from dataclasses import replace

import numpy as np
import pytest
import yaml

from tomo import Scan, load_scan
from tomo.cli.images import value_of
from tomo.inference.finding import Finding
from tomo.operators.view_gains import Gains
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.findings import with_lines
from tomo.scan import Corrections
from tomo.scan._schema import checked_corrections
from tomo.scan.advice import correction_line

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

DEEDS = {
    "add", "aim", "average", "calibrate", "check", "correct", "do", "enlarge", "expose", "give",
    "if", "leave", "let", "look", "mask", "reconstruct", "run", "see", "subtract", "to", "use",
    "where",
}  # fmt: skip
"""Words that advice begins with."""


def lines_of(warnings):
    """Return the corrections that warnings write out, by any way of giving them."""
    found, said = {}, "\n".join(warnings)
    for text in re.findall(r"corrections: \{[^}]*\}?\}", said):
        found |= yaml.safe_load(text)["corrections"]
    for name, text in re.findall(r"scan\.with_corrections\((\w+)=(\{.*?\}|[\d.e-]+)\)", said):
        found[name] = literal_eval(text)
    for name, text in re.findall(r"--(dark|gain|bit-depth|saturation) (\S*\d)", said):
        found[name.replace("-", "_")] = value_of(name, text)
    checked_corrections(found)
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


FAST = Options(method="sirt", iterations=30, refine_cameras="none", fit_gain=False, uncertainty=0)


def test_a_correction_line_is_yaml_whatever_the_cameras_are_called():
    values = {"cam03": 0.0157123, "left: {": 1.25, "7": 3e-5, "yes": 2}
    text = correction_line("scan.yaml", "dark", values)
    assert yaml.safe_load(text) == {
        "corrections": {"dark": {"cam03": 0.0157, "left: {": 1.25, "7": 3e-5, "yes": 2}}
    }
    assert correction_line("scan.yaml", "dark", 0.0157123) == "corrections: {dark: 0.0157}"


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


def lines_for(gains, scan):
    """Return the corrections that findings on gains and backgrounds propose."""
    names = scan.rig.names
    findings = [
        Finding(effect, name, float(size))
        for effect, sizes in (("gain", gains.gain - 1), ("background", gains.offset))
        for name, size in zip(names, sizes, strict=True)
    ]
    found = with_lines(findings, None, gains, names, scan)
    return lines_of({one.line for one in found if one.line})


def test_the_lines_for_gains_are_in_the_scans_own_numbers(folder):
    error, names = np.full(3, 1e-4), ("cam00", "cam01", "cam02")
    gains = Gains(np.array([1.0, 1.25, 0.8]), np.array([0.0, 0.02, 0.0]), error, error)
    scan = load_scan(folder).only(*names)
    # the scan's source alone says how: a scan.yaml, options beside a folder, Python
    for source in (scan.source, folder / "images", None):
        assert lines_for(gains, replace(scan, source=source)) == {
            "dark": {"cam01": 0.02},
            "gain": {"cam01": 0.8, "cam02": 1.25},
        }
    known = replace(scan, corrections=Corrections(dark={"cam01": 0.1, "cam02": 0.2}, gain=2.0))
    assert lines_for(gains, known) == {
        "dark": {"cam01": 0.11, "cam02": 0.2},
        "gain": {"cam01": 1.6, "cam02": 2.5},
    }
    # (raw - 0.11) * 1.6 = (b - 0.02) / 1.25 with b = (raw - 0.1) * 2
    assert pytest.approx(((0.5 - 0.1) * 2 - 0.02) / 1.25) == (0.5 - 0.11) * 1.6


def test_one_number_stands_for_a_dark_level_that_all_cameras_share(folder):
    error, scan = np.full(3, 1e-4), load_scan(folder).only("cam00", "cam01", "cam02")
    gains = Gains(np.ones(3), np.array([0.0201, 0.02, 0.0199]), error, error)
    assert lines_for(gains, scan) == {"dark": 0.02}
    small = replace(gains, offset=np.full(3, 0.002))
    assert lines_for(small, scan) == {}


def test_a_dark_image_is_no_number_to_write(folder):
    scan = load_scan(folder).only("cam00", "cam01")
    dark = {"cam00": np.zeros(scan.rig["cam00"].image_size[::-1], np.float32)}
    known = replace(scan, corrections=Corrections(dark=dark))
    gains = replace(Gains.none(2), offset=np.array([0.0, 0.02]))
    assert lines_for(gains, known) == {}


PEDESTALS = {
    "the same": dict.fromkeys(range(6), 0.04),
    "one more": {**dict.fromkeys(range(6), 0.04), 3: 0.1},
    "different": {number: 0.03 + 0.01 * number for number in range(6)},
}


@pytest.mark.parametrize("pedestal", PEDESTALS)
def test_one_dark_level_is_proposed_for_all_cameras(taken, pedestal):
    level = PEDESTALS[pedestal]
    options = Options(method="mlem", iterations=5, refine_cameras="none", uncertainty=0)
    scan = taken(lambda name, image: image + level[int(name[-1])])
    found = reconstruct(scan, options=options)
    lines = [*found.warnings, *found.verdict.next]
    assert len(re.findall(r"dark=[{\d]", "\n".join(lines))) == 1
    dark = lines_of(found.warnings)["dark"]
    assert isinstance(dark, dict) == (pedestal != "the same")
    for number, true in level.items():
        own = dark[f"cam{number:02d}"] if isinstance(dark, dict) else dark
        assert own == pytest.approx(true, abs=0.004)
    mended = replace(scan, corrections=Corrections(bit_depth=12, dark=dark))
    assert lines_of(reconstruct(mended, options=options).warnings) == {}


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
