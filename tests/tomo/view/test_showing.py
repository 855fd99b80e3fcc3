"""What `tomo.view.show` takes, and who may ask its server for what."""

import json
import socket
import urllib.error
import urllib.request
from dataclasses import replace

import numpy as np
import pytest

import rigs
from tomo import Options, reconstruct
from tomo.draw.rig.thumbnails import load_thumbnails
from tomo.draw.volume.isosurface import reference_value
from tomo.io import write_volume
from tomo.view import Viewer, content_of, show
from tomo.view.content import Frames
from tomo.view.page import compare


@pytest.fixture(scope="module")
def result(scan, as_given):
    options = Options(method="mlem", iterations=3, frame="001", **as_given)
    return reconstruct(scan.scaled(2), options=options)


@pytest.fixture(scope="module")
def viewer(scan):
    shown = show(scan.rig, port=18650)
    yield shown
    shown.stop()


@pytest.fixture(scope="module")
def film(content):
    shown = Viewer(content, 18650)
    yield shown
    shown.stop()


def test_a_reconstruction_brings_its_volume_and_the_scan_its_images(result, scan):
    alone, both = content_of(result), content_of(result, scan)
    assert alone.scan is None
    assert alone.rig.names == both.rig.names == scan.rig.names
    assert alone.grid == result.solution.grid
    assert np.array_equal(both.frames.volume(0), result.volume)
    assert both.moments == ("frame_001",)
    found = compare(both, "cam00", 0)
    assert found.measured.shape == result.views[0].measured.shape
    assert both.residual("cam00", 0) == result.views[0].relative_residual


def test_a_refined_rig_goes_with_images_as_they_were_given(result, scan):
    """Scaled by the caller, or whole as the command loads them."""
    refined = replace(result, refined_rig=scan.rig)
    for given in (scan, scan.scaled(2)):
        shown = content_of(refined, given)
        assert [one.image_size for one in shown.rig] == [(12, 14)] * 4
        assert shown.scan.images(shown.moments[0])[0].shape == (14, 12)


def test_rigs_scans_and_paths_are_shown(scan, tmp_path, result):
    assert content_of(scan.rig).rig is scan.rig
    assert content_of(scan).moments == scan.frame_names
    scan.save(tmp_path / "scan")
    rigs.save_rig(scan.rig, tmp_path / "rig.yaml")
    result.save(tmp_path / "out", with_pictures=False)
    assert content_of(tmp_path / "scan").scan is not None
    assert content_of(tmp_path / "rig.yaml").scan is None
    assert np.array_equal(content_of(tmp_path / "out").frames.volume(0), result.volume)
    with pytest.raises((ValueError, FileNotFoundError), match="nothing"):
        content_of(tmp_path / "nothing")


def test_a_notebook_shows_the_page(viewer):
    assert f'<iframe src="{viewer.url}"' in viewer._repr_html_()
    with pytest.raises(ValueError, match="camera: found 'cam00', expected one of"):
        viewer.choose("cam00")


def asked(url, **headers):
    """Return the status and the body of an answer."""
    names = {name.replace("_", "-"): value for name, value in headers.items() if value}
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=names)) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


@pytest.mark.parametrize(
    ("origin", "host", "may"),
    [
        (None, None, True),
        ("http://localhost:9000", "localhost:9000", True),
        ("{url}", None, True),
        ("https://elsewhere.example", None, False),
        ("http://127.0.0.1.elsewhere.example:8080", None, False),
        ("null", None, False),
        (None, "localhost.elsewhere.example", False),
    ],
)
def test_pages_from_elsewhere_are_refused(viewer, origin, host, may):
    origin = origin.format(url=viewer.url) if origin else None
    assert asked(viewer.url, Origin=origin, Host=host)[0] == (200 if may else 403)


def test_another_page_may_not_take_or_frame_an_answer(viewer):
    with urllib.request.urlopen(viewer.url) as answer:
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert "Access-Control-Allow-Origin" not in answer.headers
        assert answer.headers["Content-Security-Policy"].startswith("frame-ancestors 'self'")


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/volume/-1", "/images/x",
        "/volume/0/../../setup.cfg", "/compare/0/999", "/volume/1" + "0" * 40, "/?file=/etc",
    ],
)  # fmt: skip
def test_nothing_but_numbers_can_be_asked_for(film, path):
    assert asked(film.url + path) == (404, b"nothing here")


def test_answers_are_those_of_the_content_and_errors_one_line(content, flames):
    def read(place):
        if place == 2:
            raise ValueError("frame 2:\n damaged")
        return flames[place]

    broken = replace(content, frames=Frames(("a", "b", "c"), read, most_bytes=0))
    broken.frames.__dict__["spread"] = lambda: [0]
    shown = Viewer(broken, 18650)
    try:
        steps = np.frombuffer(asked(shown.url + "/volume/1")[1], np.uint8)
        share = np.minimum(flames[1].ravel() / reference_value(flames[0]), 1)
        np.testing.assert_allclose(steps, 255 * share, atol=0.51)
        assert asked(shown.url + "/volume/2") == (500, b"frame 2: damaged")
        entry = json.loads(asked(shown.url + "/compare/0/3")[1])
        assert entry["words"].startswith("cam03: residual 0.0%")
        assert [one[:22] for one in entry["images"]] == ["data:image/png;base64,"] * 3
    finally:
        shown.stop()


def test_no_port_but_a_free_one_is_taken(scan):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        shown = show(scan.rig, port=port)
    assert port < int(shown.url.rpartition(":")[2]) < port + 1000
    shown.stop()
    with pytest.raises(ValueError, match="port: found 0, expected a number from 1 to 65535"):
        show(scan.rig, port=0)


def test_a_rig_stays_the_one_that_was_named_by_a_scan(scan):
    moved = replace(scan.rig, cameras=tuple(one.shifted(2.0, 0.0) for one in scan.rig))
    assert content_of(moved, scan).rig == moved
    assert content_of(scan).rig == scan.rig


def test_a_volume_file_is_shown_by_the_cameras_of_a_scan(scan, grid, flames, tmp_path):
    write_volume(tmp_path / "flame.npz", flames[0], grid, scan.rig.length_unit)
    both = content_of(tmp_path / "flame.npz", scan)
    assert both.rig.names == scan.rig.names
    assert compare(both, "cam00", 0).measured.shape == (28, 24)


def test_moments_that_a_camera_lacks_are_not_offered(scan):
    first = replace(scan.frames[0], images={"cam00": scan.frames[0].images["cam00"]})
    late = replace(scan, frames=(first, *scan.frames[1:]))
    assert content_of(late).moments == scan.frame_names[1:]
    assert sorted(load_thumbnails(late.rig, late)) == ["cam00"]
