"""A scan file with anything in it is loaded, or refused in one line that names the field."""

import copy
import shutil

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tomo import load_scan


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda c: c.update(format="emission-rig"), ["format", "'emission-rig'", "emission-scan"]),
        (lambda c: c.update(version=2), ["version", "found 2", "expected 1"]),
        (lambda c: c.update(format="emission-rig", cameras=[]), ["format: found 'emission-rig'"]),
        (lambda c: c.pop("frames"), ["frames: missing, expected a list of mappings"]),
        (lambda c: c.update(frames=[]), ["frames: found none, expected at least one"]),
        (lambda c: c["frames"].append(copy.deepcopy(c["frames"][0])), ["'first'", "twice"]),
        (
            lambda c: c["frames"][0].update(name=7),
            ["frames[0]: name: found 7, expected text (put it in quotes)"],
        ),
        (
            lambda c: c["frames"][0]["images"].update(left=3),
            ["frame 'first': images.left: found 3, expected text"],
        ),
        (lambda c: c.update(colour="red"), ["colour", "unknown field"]),
        (
            lambda c: c.update(trut=c.pop("truth", "x")),
            ["trut: unknown field, did you mean truth?"],
        ),
        (lambda c: c.update(grid="3x4x5"), ["grid: found '3x4x5', expected a mapping"]),
        (
            lambda c: c["grid"].update(shape=[1, 2]),
            ["grid.shape: found 2 values, expected a list of 3 whole numbers"],
        ),
        (lambda c: c["grid"].update(spacing=-1.0), ["grid spacing", "-1.0"]),
        (lambda c: c["grid"].update(spacing=float("nan")), ["grid.spacing", "nan"]),
        (lambda c: c.update(corrections={"gain": 0}), ["corrections.gain", "found 0"]),
        (
            lambda c: c.update(corrections={"gain": {"left": "x"}}),
            ["corrections.gain", "camera left", "'x'"],
        ),
        (lambda c: c.update(corrections={"gain": {"cam9": 1}}), ["corrections.gain", "'cam9'"]),
        (lambda c: c.update(corrections={"gain": {"a\nb": "x"}}), ["corrections.gain", "a\\nb"]),
        (lambda c: c["frames"][0]["images"].update({"a\nb": "../x"}), ["frame 'first'", "a\\nb"]),
        (lambda c: c.update(corrections={"bit_depth": 33}), ["corrections.bit_depth", "33"]),
        (lambda c: c.update(corrections={"mask": True}), ["corrections.mask", "True"]),
        (lambda c: c.update(truth="a\0b"), ["truth"]),
        (
            lambda c: c.update(corrections={"dark": "a\r"}),
            ["corrections.dark: found 'a\\r', expected a path"],
        ),
        (lambda c: c.update(truth="x" * 5000), ["truth"]),
        (lambda c: c.update(effects={"heat": 1.0}), ["effects.heat", "unknown field"]),
        (lambda c: c.update(effects={"absorption": "k"}), ["effects.absorption", "found 'k'"]),
        (lambda c: c.update(effects={"gains": {"cam9": 1.0}}), ["effects.gains", "'cam9'"]),
    ],
)
def test_bad_fields_are_named(folder, change, parts, edit, assert_refused):
    edit(folder, change)
    assert_refused(lambda: load_scan(folder), "scan.yaml", *parts)


@pytest.mark.parametrize("content", ["", "[1, 2", "- 1", "a: &a [*a]", "x: 2001-99-99", "\0"])
def test_what_is_no_scan_file(folder, content, assert_refused):
    (folder / "scan.yaml").write_text(content)
    assert_refused(lambda: load_scan(folder), "scan.yaml")


def test_nothing_there(tmp_path, assert_refused):
    for path in (tmp_path, tmp_path / "none", tmp_path / "none.yaml"):
        assert_refused(lambda path=path: load_scan(path), str(path), error=FileNotFoundError)
    (tmp_path / "scan.txt").write_text("")
    assert_refused(lambda: load_scan(tmp_path / "scan.txt"), "'.txt'")


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_scan_file_with_anything_in_it_loads_or_is_refused_in_one_line(folder, data):
    path = folder / "scan.yaml"
    if not (folder / "good.yaml").exists():
        shutil.copy(path, folder / "good.yaml")
    content = yaml.safe_load((folder / "good.yaml").read_text())
    content["corrections"] = {"dark": {"left": 0.1}, "gain": 2.0}
    spots = [(content, key) for key in content]
    spots += [(content["frames"][0], key) for key in ("name", "images")]
    spots += [(content["corrections"], key) for key in ("dark", "gain")]
    spots += [(content["grid"], key) for key in content["grid"]]
    holder, key = data.draw(st.sampled_from(spots))
    holder[key] = data.draw(ANYTHING)
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    try:
        load_scan(folder)
    except (ValueError, FileNotFoundError, IsADirectoryError) as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
        assert "scan" in str(error)  # noqa: PT017


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8")))
def test_any_bytes_are_refused_in_one_line(folder, assert_refused, content):
    (folder / "scan.yaml").write_bytes(content)
    assert_refused(lambda: load_scan(folder), "scan.yaml")
