"""docs/reference/rig_formats.md against the registry, and against what files give back."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lens_formulas import COEFFICIENTS

from rigs import Accuracy, Camera, Distortion, Optics, RayTable, Rig, formats, look_at
from rigs.formats import FORMATS
from rigs.rig import Volume

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "rig_formats.md"
K = [[90.0, 0, 31.5], [0, 90.0, 23.5], [0, 0, 1]]
POINTS = [[1.0, 2, 3], [-4, 1, -2], [2, -3, 5]]


def tables():
    """The tables of the page, a list of rows each; the first row is the head."""
    found = [[]]
    for line in PAGE.read_text("utf-8").splitlines():
        if line.startswith("|"):
            cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
            found[-1].append(cells)
        elif found[-1]:
            found.append([])
    return [[rows[0], *rows[2:]] for rows in found if rows]


def ring(**changed):
    """Three cameras round the origin."""
    cameras = []
    for number, angle in enumerate((0.0, 1.0, 2.0)):
        R, t = look_at((200 * np.sin(angle), 0, 200 * np.cos(angle)), (0, 0, 0))
        values = {"camera_matrix": K, "status": "calibrated", **changed}
        cameras.append(Camera(f"cam{number}", (64, 48), R=R, t=t, **values))
    return Rig(tuple(cameras), "mm")


def same_views(rig, other):
    pairs = zip(rig, other, strict=True)
    return all(
        np.allclose(a.project(POINTS)[0], b.project(POINTS)[0], atol=1e-6) for a, b in pairs
    )


def same(field):
    return lambda rig, other: getattr(rig, field) == getattr(other, field)


def same_of_cameras(*fields):
    return lambda rig, other: all(
        np.all(getattr(a, field) == getattr(b, field))
        for a, b in zip(rig, other, strict=True)
        for field in fields
    )


PLAIN = ring()
#: For each row of the page: a rig that has it, and whether another still has it.
FEATURES = {
    "names and image sizes": (PLAIN, same_of_cameras("name", "image_size")),
    "poses": (PLAIN, same_views),
    "focal lengths, principal points": (
        ring(camera_matrix=[[90.0, 0, 35], [0, 95.0, 20], [0, 0, 1]]),
        same_views,
    ),
    "skew": (ring(camera_matrix=[[90.0, 0.5, 31.5], [0, 90.0, 23.5], [0, 0, 1]]), same_views),
    **{
        f"lens `{model}": (ring(distortion=Distortion(model, values)), same_views)
        for model, values in COEFFICIENTS.items()
        if values
    },
    "ray tables": (
        replace(PLAIN, cameras=(RayTable.of(PLAIN[0]), *PLAIN[1:])),
        lambda rig, other: not other[0].has_lens_model,
    ),
    "length unit": (PLAIN, same("length_unit")),
    "world frame": (replace(PLAIN, world_frame="origin on the burner"), same("world_frame")),
    "volume": (replace(PLAIN, volume=Volume((3, 4, 5), 0.5)), same("volume")),
    "optics": (ring(optics=Optics(25, 8, 300, 0.0074)), same_of_cameras("optics")),
    "status": (ring(status="nominal"), same_of_cameras("status")),
    "accuracy": (ring(accuracy=Accuracy(shift=0.1)), same_of_cameras("accuracy")),
    "calibration figures": (replace(PLAIN, calibration={"ray_miss": 0.1}), same("calibration")),
}
PATHS = {"emission_rig": "rig.yaml", "colmap": "model", "transforms": "transforms.json",
         "opencv": "rig.yml", "astra": "rig.astra.json", "rtk": "rig.xml"}  # fmt: skip


def outcome(rig, kept, name, folder):
    """What a format makes of a rig, in the words of the page."""
    path = folder / PATHS[name]
    try:
        formats.save(rig, path, name)
    except ValueError:
        return "refused"
    if not FORMATS[name].reads:
        return "written"
    return "kept" if kept(rig, formats.load(path, name)) else "lost"


def test_the_page_has_the_formats_of_the_registry_in_their_order():
    head, *rows = tables()[0]
    assert head[2:4] == ["read", "written"]
    marks = {row[0]: tuple(row[2:4]) for row in rows}
    yes = {True: "yes", False: ""}
    assert marks == {name: (yes[i.reads], yes[i.writes]) for name, i in FORMATS.items()}
    assert [row[0] for row in rows] == list(FORMATS)


def test_every_format_that_is_read_says_where_its_image_size_comes_from():
    for row in tables()[0][1:]:
        said = re.fullmatch(r"in the file|((in the file|from images), or )?asked for", row[4])
        assert bool(said) == FORMATS[row[0]].reads, row[0]


@pytest.mark.parametrize("feature", FEATURES)
def test_what_is_lost_by_writing_is_as_the_page_says(tmp_path, feature):
    head, *rows = tables()[1]
    assert head[1:] == list(formats.names(writable=True))
    said = {row[0]: row[1:] for row in rows}
    assert list(said) == list(FEATURES)
    rig, kept = FEATURES[feature]
    found = []
    for name in head[1:]:
        (tmp_path / name).mkdir()
        found.append(outcome(rig, kept, name, tmp_path / name))
    assert found == said[feature]
