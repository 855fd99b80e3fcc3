"""A volume stands, whatever fails in its evaluation afterwards."""

import json

import numpy as np
import pytest

from tomo import load_scan, wernet
from tomo.pipeline import Options, assess, evaluate, infer, reconstruct
from tomo.report import result_figures
from tomo.report.outcome_files import write_outcome

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves", "coarse_scenes")


class OfALibraryError(Exception):
    """Of no kind that anybody expects."""


QUICK = Options(method="mlem", iterations=3, refine_cameras="none")


@pytest.fixture
def scan(folder):
    return load_scan(folder).scaled(2)


@pytest.fixture(scope="module")
def whole(folder):
    return reconstruct(load_scan(folder).scaled(2), options=QUICK)


@pytest.fixture
def broken(monkeypatch):
    """Return a function that makes a function of a module or class raise."""

    def breaks(where, name, error):
        def fails(*_arguments, **_named):
            raise error

        monkeypatch.setattr(where, name, fails)

    return breaks


@pytest.mark.parametrize(
    ("where", "name", "error", "said"),
    [
        (infer, "infer", MemoryError(), "effects of cameras and gas: not looked for"),
        (assess, "assess_volume", OfALibraryError("two\nlines"), "uncertainty: not found"),
        (evaluate, "views_of", ValueError("wrong"), "re-projected images: not found: wrong"),
    ],
)
def test_a_step_of_the_evaluation_may_fail(
    scan, whole, broken, tmp_path, where, name, error, said
):
    broken(where, name, error)
    found = reconstruct(scan, options=QUICK)
    np.testing.assert_array_equal(found.volume, whole.volume)
    (warning,) = [line for line in found.warnings if line.startswith(said)]
    assert "\n" not in warning
    if not isinstance(error, ValueError):
        assert type(error).__name__ in warning
    write_outcome(tmp_path / "out", found, with_pictures=False)
    warnings = json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]
    assert warning in warnings


def test_a_comparison_that_diverges_costs_nothing_but_itself(scan, broken, as_given):
    broken(wernet, "wernet_paper", wernet.TrainingDivergedError("loss: found NaN"))
    compared = Options(
        method="mlem", iterations=3, compare=["wernet-paper:1", "mlem:2"], **as_given
    )
    found = reconstruct(scan, options=compared)
    assert len(found.comparisons) == 1
    assert any("comparison wernet-paper" in line and "NaN" in line for line in found.warnings)


def test_a_picture_that_cannot_be_drawn_is_reported(whole, broken, tmp_path):
    broken(result_figures, "draw_convergence", ImportError("libGL.so.1: cannot open"))
    write_outcome(tmp_path / "out", whole)
    assert (tmp_path / "out" / "volume.npz").exists()
    assert not (tmp_path / "out" / "convergence.png").exists()
    assert (tmp_path / "out" / "flame.png").exists()
    words = "picture convergence: not drawn: ImportError: libGL.so.1: cannot open"
    warnings = json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]
    assert any(line.startswith(words) for line in warnings)
    assert words[1:] in (tmp_path / "out" / "report.html").read_text()
