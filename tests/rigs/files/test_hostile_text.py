"""Text files that once took the process down, hung it, or raised what no caller expects."""

import contextlib

import pytest
from promptness import takes_less_than

from rigs import formats, load_rig
from rigs.files import text

BLANKS = 60_000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[" * 60_000, "nested too deeply"),  # overflowed the stack of C
        ("a: " + "[" * 60_000, "nested too deeply"),
        ("? " * 30_000, "nested too deeply"),
        ("a: [" + "1," * 1100 + "1]", "found more than 1000 values"),
        ("!!int ", "broken YAML"),  # IndexError
        ("a: !!float", "broken YAML"),
        ("a: &a [1]\nb: *a", "found a YAML alias to line 1"),
        ("a: *b", "found a YAML alias to line 1"),
    ],
)
def test_yaml_is_weighed_before_it_is_built(tmp_path, monkeypatch, content, message):
    monkeypatch.setattr(text, "_MAX_VALUES", 1000)
    path = tmp_path / "rig.yaml"
    path.write_text(content)
    with pytest.raises(ValueError, match=message) as caught:
        load_rig(path)
    assert len(str(caught.value).splitlines()) == 1


def test_the_images_of_a_long_run_are_not_too_many(monkeypatch):
    """A second at 12 kHz by eight cameras, and the most that is read, both at a twentieth."""
    monkeypatch.setattr(text, "_MAX_VALUES", text._MAX_VALUES // 20)
    names = [f"cam{camera:02d}" for camera in range(8)]
    frames = "".join(
        f"- {{name: {k}, images: {{{', '.join(f'{name}: {name}/{k}.tif' for name in names)}}}}}\n"
        for k in range(600)
    )
    assert len(text.yaml_mapping(f"frames:\n{frames}", "scan.yaml")["frames"]) == 600


def test_a_number_of_voxels_beyond_64_bits_is_refused(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(
        "format: emission-rig\nversion: 1\ncameras: []\n"
        f"volume: {{shape: [3, 4, {10**30}], spacing: 1}}\n"
    )
    with pytest.raises(ValueError, match=r"volume.shape\[2\]: found 10+, expected a whole"):
        load_rig(path)


def test_toml_keys_of_many_parts_are_refused(tmp_path):
    path = tmp_path / "calibration.toml"
    for content in (
        "a." * 9000 + "b = 1",
        "[" + "a." * 9000 + "b]",
        "x = {" + "a." * 9000 + "b = 1}",
    ):
        path.write_text(content)
        with pytest.raises(ValueError, match="nested too deeply"):
            formats.load(path, "anipose")


@pytest.mark.parametrize("suffix", [".toml", ".yaml", ".txt", ".json"])
@pytest.mark.parametrize(
    "content",
    [
        "\n" * BLANKS,
        " " * BLANKS,
        "1" + "\n" * BLANKS,
        "1\n" + "a." * (BLANKS // 2),
        "cam0:\n" + " \n" * (BLANKS // 2),
    ],
    ids=["lines", "spaces", "count", "dots", "camera"],
)
def test_telling_formats_apart_takes_time_in_proportion(tmp_path, suffix, content):
    """Patterns that backtrack take 10 s and more for these; others take milliseconds."""
    path = tmp_path / f"rig{suffix}"
    path.write_text(content)
    with takes_less_than(2), contextlib.suppress(ValueError):
        formats.sniff(path)


@pytest.mark.parametrize("name", ["a\nb.npz", "a\u2028b.npz", "a.npz\n"])
def test_a_path_of_two_lines_is_no_path(tmp_path, name):
    path = tmp_path / "rig.yaml"
    escaped = name.encode("unicode_escape").decode()
    path.write_text(
        f'format: emission-rig\nversion: 1\ncameras: [{{name: a, ray_table: "{escaped}"}}]\n'
    )
    with pytest.raises(ValueError, match="expected a path inside") as caught:
        load_rig(path)
    assert len(str(caught.value).splitlines()) == 1
