"""The page of a calibration: does it say what the calibration found, and load nothing?"""

import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigs
from rigs.calibrate import Observations, calibrate
from rigs.calibrate.targets import Chessboard
from tomo.draw import write_calibration_page
from tomo.draw.figures import png_bytes
from tomo.draw.rig.calibration_figures import draw_worst, worst_images
from tomo.draw.rig.surroundings import calibration_targets

BOARD = Chessboard(6, 5, 22.0)
FRAMES = 10
WRONG = ("cam<1>", "frame 7")  # two points of it were detected 4 px beside


def observed(names=("cam0", "cam<1>", "cam2")):
    """Return what three cameras see of a board, with noise and two points gone wrong."""
    generator = np.random.default_rng(4)
    rig = rigs.arc(len(names), 50.0, 600.0, image_size=(320, 256), footprint=0.6)
    upright = Rotation.from_euler("x", 180, degrees=True)
    frames = tuple(f"frame {k}" for k in range(FRAMES))
    rows = []
    for frame in range(FRAMES):
        own = Rotation.from_euler("xyz", generator.uniform(-28, 28, 3), degrees=True)
        R = (upright * own).as_matrix()
        t = generator.uniform(-30, 30, 3) - R @ BOARD.points.mean(axis=0)
        for index, camera in enumerate(rig):
            uv, _, _ = camera.project(BOARD.points @ R.T + t)
            uv += 0.05 * generator.standard_normal(uv.shape)
            if (names[index], frames[frame]) == WRONG:
                uv[[3, 20]] += 4.0
            place = np.arange(len(uv))
            rows.append(
                np.column_stack([np.full((len(uv), 2), (index, frame)), place, uv])
            )  # (points, 5)
    table = np.concatenate(rows)
    sizes = tuple(camera.image_size for camera in rig)
    return Observations(
        BOARD.points, names, sizes, frames, *table[:, :3].astype(int).T, table[:, 3:]
    )


@pytest.fixture(scope="module")
def calibration():
    return calibrate(observed())


def image_of(camera, frame):
    return np.full((256, 320), 90, np.uint8)


@pytest.fixture(scope="module")
def page(calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "calibration.html"
    write_calibration_page(
        path, calibration, title="Rig <A>", image_of=image_of, details={"target": str(BOARD)}
    )
    assert [p.name for p in path.parent.iterdir()] == ["calibration.html"]
    return path.read_text("utf-8")


def rows(page, heading):
    """Return the cells of the table under a heading, row by row."""
    body = page.split(f"<h2>{heading}</h2>")[1].split("</tbody>")[0].split("<tbody>")[1]
    return [
        [html.unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall("<t[hd].*?</t", row)]
        for row in body.split("<tr")[1:]
    ]


def test_the_assessment_and_every_finding_stand_on_the_page(page, calibration):
    text = html.unescape(re.sub("<[^>]*>", "", page.split("<h2>")[0]))
    first, *rest = calibration.assessment.split("\n")
    word, _, words = first.partition(": ")
    assert f">{word.capitalize()}</span>" in page
    assert words in " ".join(text.split())
    assert rest
    for finding in rest:
        assert finding in text
    assert WRONG[0] in rest[0]
    assert f"{calibration.quality.predicted_ray_miss:.2g} mm" in text


def test_the_tables_hold_every_camera_and_frame_with_its_own_residual(page, calibration):
    squares = (calibration.residuals**2).sum(axis=1)
    observations = calibration.observations
    for heading, names, group in (
        ("Cameras", observations.cameras, observations.camera),
        ("Frames", observations.frames, observations.frame),
    ):
        table = rows(page, heading)
        assert [row[0].removesuffix("</t") for row in table] == list(names)
        for index, row in enumerate(table):
            own = calibration.used & (group == index)
            expected = np.sqrt(squares[own].mean())
            assert float(row[1].removesuffix("</t")) == pytest.approx(expected, rel=6e-3)


def test_the_guilty_camera_is_marked_and_no_other(page):
    table = page.split("<h2>Cameras</h2>")[1].split("</table>")[0]
    assert re.findall('class="held-out"><th scope="row">(.*?)<', table) == ["cam&lt;1&gt;"]


def drawn(page):
    """Return the data of the page's drawing, and the page without scripts."""
    (data,) = re.findall(r'"application/json">(.*?)</script>', page, re.DOTALL)
    # a browser refuses NaN and Infinity
    read = json.loads(data, parse_constant=lambda found: pytest.fail(f"{found} in JSON"))
    return read, re.sub("<(script|style).*?</\\1>", "", page, flags=re.DOTALL)


def test_the_page_loads_nothing_and_escapes_names(page):
    assert "default-src 'none'" in page
    data, outside = drawn(page)
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", outside)
    assert outside.count("data:image/png;base64,") == 5  # four figures, and the drawing's still
    assert "<title>Rig &lt;A&gt;</title>" in page
    assert "cam<1>" not in page
    assert {label["text"] for label in data["labels"]} >= {"cam0", "cam<1>", "cam2"}
    assert str(BOARD) in page


def test_the_page_is_whole_without_images_and_with_one_camera(tmp_path):
    observations = observed()
    alone = observations.where(observations.camera == 0)
    alone = replace(alone, cameras=("cam0",), image_sizes=alone.image_sizes[:1])
    write_calibration_page(tmp_path / "calibration.html", calibrate(alone))
    text = (tmp_path / "calibration.html").read_text("utf-8")
    assert "Images that fit worst" not in text
    assert "predicted ray-miss" not in text
    data, outside = drawn(text)
    assert data["meshes"]
    assert "nan" not in html.unescape(re.sub("<[^>]*>", "", outside))


def test_the_worst_image_is_the_one_with_wrong_points(calibration):
    observations = calibration.observations
    (camera, frame, rms), *others = worst_images(calibration)
    assert (observations.cameras[camera], observations.frames[frame]) == WRONG
    assert rms == pytest.approx(np.sqrt(2 * 32 / len(BOARD.points)), rel=0.1)
    assert all(rms > other for *_, other in others)
    assert len({(c, f) for c, f, _ in others}) == len(others) == 5


def test_the_worst_images_are_asked_for_and_drawn(calibration):
    asked = []

    def left_dark(camera, frame):
        asked.append((camera, frame))
        return np.repeat([[10] * 160 + [250] * 160], 256, axis=0).astype(np.uint8)

    drawn = png_bytes(draw_worst(calibration, left_dark, 1))
    assert asked == [WRONG]
    assert drawn != png_bytes(draw_worst(calibration, lambda c, f: left_dark(c, f)[:, ::-1], 1))
    assert draw_worst(calibration, lambda camera, frame: None) is None


def test_targets_stand_in_the_scene_where_the_calibration_has_them(calibration):
    scene = calibration_targets(calibration)
    assert len(scene.meshes) == 2 * FRAMES
    faces = [mesh for mesh in scene.meshes if mesh.opacity < 1]
    for frame, mesh in enumerate(faces):
        R, t = calibration.target_R[frame], calibration.target_t[frame]
        corners = BOARD.points[[0, 5, 29, 24]] @ R.T + t
        np.testing.assert_allclose(mesh.vertices[1:], corners, atol=1e-9)
        assert mesh.name.startswith(f"frame {frame}:")
