import numpy as np
import pytest

from rigs import ring
from tomo.grid import Volume, VoxelGrid
from tomo.operators import LinearSystem
from tomo.pipeline import Reconstruction
from tomo.pipeline.view import Peak, View
from tomo.report.outcome_files import DEVIATION_FILES, drawn, write_outcome
from tomo.report.result_figures import draw_deviations
from tomo.report.uncertainty_tables import coverage_table, trust_figures
from tomo.solvers import Solution
from tomo.uncertainty import assess

GRID = VoxelGrid((6, 8, 6), 1.0)

pytestmark = pytest.mark.usefixtures("coarse_scenes")


@pytest.fixture(scope="module")
def system():
    return LinearSystem.from_rig(
        ring(4, distance=100.0, image_size=(16, 16), footprint=1.0, pitch_degrees=10.0), GRID
    )


def condition_of(system, repeats):
    A = system.projector
    volume = np.exp(-(GRID.centers() ** 2).sum(axis=-1) / 4).astype(np.float32)
    random = np.random.default_rng(1)
    measured = (A @ volume.ravel() + 0.1 * random.standard_normal(A.shape[0])).astype(np.float32)

    def solve(pixels):
        return (A.T @ pixels / A.column_sums.max() ** 2).astype(np.float32)

    return assess(system, measured, volume, solve, repeats=repeats)


@pytest.fixture(scope="module")
def few(system):
    return condition_of(system, 2)


def outcome_of(system, repeats):
    condition = condition_of(system, repeats)
    volume = condition.volume.reshape(GRID.shape)
    image = np.ones((16, 16), np.float32)
    return Reconstruction(
        Solution(volume, GRID, (), {"method": "nnls"}),
        system.rig,
        tuple(View(name, image, image) for name in system.rig.names),
        Peak(1.0, ""),
        uncertainty=condition,
    )


def test_the_figure_has_two_volumes_each_on_its_own_scale():
    volume = Volume(np.random.default_rng(0).random(GRID.shape), GRID)
    figure = draw_deviations(volume, 1e-3 * volume)
    scales = [axes.get_images()[0].get_clim()[1] for axes in figure.axes if axes.get_images()]
    assert len(scales) == 6
    assert scales[0] == pytest.approx(1e3 * scales[3])
    with pytest.raises(ValueError, match="volume: found shape"):
        draw_deviations(volume, volume[1:])


def test_all_voxels_are_in_the_table_and_each_figure_has_its_meaning(few):
    report = few.report()
    views = coverage_table(report)["rows"]
    counted = sum(int(row[1].split()[0].replace(",", "")) for row in views)
    assert counted == GRID.size
    assert views[-1][0].endswith("4")  # of four cameras: no bin promises more
    figures = trust_figures({"uncertainty": report}, "mm")
    names = [name for _, name, _ in figures]
    assert "resolution along x, y, z" in names
    assert "finest details that the cameras measure" in names
    assert all(value and words.endswith(".") for value, _, words in figures)


@pytest.mark.parametrize("lacking", ["standard_deviation", "resolution", "intervals"])
def test_what_is_not_known_is_left_out(few, lacking):
    report = few.report()
    del report[lacking]
    assert trust_figures({"uncertainty": report}, "mm")
    assert coverage_table(None) is None


def test_single_voxels_deviations_are_written_only_where_they_are_known(system, tmp_path):
    others = ("rig", "flame", "convergence", "difference", "flame.html", "rig.html")

    def write(outcome):
        write_outcome(tmp_path, outcome, known=drawn(outcome, others))

    write(outcome_of(system, 12))
    assert all((tmp_path / name).is_file() for name in (*DEVIATION_FILES, "condition.png"))
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "How far off can it be?" in page
    assert "What noise does to every voxel" in page
    write(outcome_of(system, 3))
    assert not any((tmp_path / name).exists() for name in (*DEVIATION_FILES, "condition.png"))
    assert "How far off can it be?" in (tmp_path / "report.html").read_text("utf-8")
