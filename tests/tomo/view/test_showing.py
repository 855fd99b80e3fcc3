"""What `tomo.view.show` takes, and who may connect to its page."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("viser")

import rigs
from tomo import Options, reconstruct
from tomo.view import content_of, show
from tomo.view.comparison import compare


@pytest.fixture(scope="module")
def result(scan):
    options = Options(method="mlem", iterations=3, uncertainty=0, frame="001")
    return reconstruct(scan.scaled(2), options=options)


@pytest.fixture
def viewer(scan):
    shown = show(scan.rig, port=18650)
    yield shown
    shown.stop()


def test_a_reconstruction_brings_its_volume_and_the_scan_its_images(result, scan):
    alone, both = content_of(result), content_of(result, scan)
    assert alone.scan is None
    assert alone.rig.names == both.rig.names == scan.rig.names
    assert alone.grid == result.solution.grid
    assert np.array_equal(both.frames.volume(0), result.volume)
    assert both.moments == ("frame_001",)
    found = compare(both.scan, "frame_001", "cam00", result.volume, both.grid, both.model)
    assert found.measured.shape == result.views[0].measured.shape
    assert both.residual("cam00", 0) == result.views[0].relative_residual


def test_a_refined_rig_goes_with_images_as_they_were_given(result, scan):
    """Scaled by the caller, or whole as the command loads them."""
    refined = replace(result, refined_rig=scan.rig)
    for given in (scan, scan.scaled(2)):
        shown = content_of(refined, given)
        assert [one.image_size for one in shown.rig] == [(12, 14)] * 4
        assert shown.images(0)["cam00"].shape == (14, 12)


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


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        (None, True),
        ("http://localhost:9000", True),
        ("{url}", True),
        ("https://elsewhere.example", False),
        ("http://localhost.elsewhere.example", False),
        ("http://127.0.0.1.elsewhere.example:8080", False),
        ("null", False),
    ],
)
def test_pages_from_elsewhere_cannot_connect(viewer, origin, may):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = viewer.url.replace("http:", "ws:")
    given = origin.format(url=viewer.url) if origin else None
    if may:
        connect(address, origin=given).close()
    else:
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, origin=given)


def test_other_servers_of_the_program_are_left_as_they_were(viewer):
    from websockets.asyncio import server

    assert server.serve is server.__dict__["serve"]
    assert isinstance(server.serve, type)
