"""The benchmark's part for a GPU, on a stand-in; and what is said without one."""

import sys
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from studies import gpu as script
from studies.benchmark import gpu
from studies.common.study import Request

from tomo import Options
from tomo.operators.gpu import CudaDevice

pytestmark = pytest.mark.usefixtures("quick_choices")


@pytest.fixture
def plume(tmp_path):
    """Return a folder with a film as `plume_series`: small, and of ten frames."""
    from tifffile import imwrite

    import rigs
    from tomo import VoxelGrid
    from tomo.operators import LinearSystem

    grid = VoxelGrid((8, 9, 8), 0.01)
    rig = rigs.ring(4, distance=2.0, image_size=(12, 14), footprint=0.008, pitch_degrees=12.0)
    system, (x, y, z) = LinearSystem.from_rig(rig, grid, skip=False), grid.centers().T
    spot = np.exp(-(x**2 + y**2 + z**2) / 0.02**2).T.astype(np.float32)
    folder = tmp_path / gpu.PLUME
    folder.mkdir()
    rigs.save_rig(rig, folder / "rig.yaml")
    images = system.images(system.projector @ spot.ravel())
    for name, image in zip(rig.names, images, strict=True):
        steps = np.linspace(0.8, 1.0, 10)[:, None, None]
        frames = (60_000 * steps * image / image.max()).astype(np.uint16)
        imwrite(folder / f"{name}.tif", frames, photometric="minisblack")
    box = grid.shape, tuple(grid.lower), tuple(grid.upper)
    return SimpleNamespace(folder=tmp_path, box=box)


def test_the_part_measures_all_that_a_gpu_is_to_show(cupy, plume, monkeypatch, as_given):
    monkeypatch.setattr(gpu, "PLUME_BOX", plume.box)
    monkeypatch.setattr(gpu, "REPEATS", 1)
    tiny = gpu.SIZES["tiny"]
    monkeypatch.setitem(gpu.SIZES, "tiny", replace(tiny, frames=10))
    monkeypatch.setattr(gpu, "instructions", lambda kernel: 30.0)
    gains_alone = Options(refine_cameras="none", fit_absorption=False, uncertainty=0)
    monkeypatch.setattr(gpu, "reconstruct", partial(gpu.reconstruct, options=gains_alone))
    film = partial(gpu.reconstruct_series, options=Options(key_frames=2, **as_given))
    monkeypatch.setattr(gpu, "reconstruct_series", film)
    tables = gpu.run(Request("tiny", data=plume.folder))
    assert all(row["holds"] for row in tables["errors"])
    assert [row["product"] for row in tables["rates"]] == ["forward", "adjoint"]
    for row in tables["rates"]:
        rays = 2 * 16 * 12
        assert row["gray_per_second"] == pytest.approx(rays / row["seconds"] / 1e9)
        share = 30 * row["crossings_per_second"] / (132 * 128 * 1.98e9)
        assert row["issue_share"] == pytest.approx(share)
    *demo, large = tables["solves"]
    assert [row["where"] for row in demo] == ["cpu", "cuda"] * 2
    whole, effects = np.reshape([row["seconds"] for row in demo], (2, 2))
    assert (effects > 0).all()
    assert (effects < whole).all()
    assert large["what"] == "8^3, 3 views of 12 x 12, 30 iterations"
    assert large["gigabytes"] == pytest.approx(3.2, abs=0.1)
    own, there = tables["film"]
    assert own["off"] == 0
    assert there["off"] < 1e-3
    assert min(own["milliseconds_a_frame"], there["milliseconds_a_frame"]) > 0


def test_diffct_is_measured_where_it_is_installed(cupy, monkeypatch):
    made = []

    class Projector:
        def __init__(self, way, shape, detector, detector_spacing):
            made.append((way, shape, detector, detector_spacing))

        project = backproject = staticmethod(lambda argument: argument)

    torch = SimpleNamespace(
        rand=lambda shape, device: np.zeros(shape),
        cuda=SimpleNamespace(synchronize=lambda: None),
    )
    peer = SimpleNamespace(
        __version__="9.9",
        Projector=Projector,
        circular_trajectory_3d=lambda views, sid, sdd, device: (views, sid, sdd),
    )
    monkeypatch.setitem(sys.modules, "diffct", peer)
    monkeypatch.setitem(sys.modules, "torch", torch)
    ours, theirs = np.array_split(gpu.rates(CudaDevice(), 6, 2, (16, 12)), 2)
    assert made == [((2, 24.0, 24.0), (6, 6, 6), (16, 12), 0.75)]
    assert {row["what"] for row in ours} == {"flametomo"}
    assert {row["what"] for row in theirs} == {"diffct 9.9"}


def test_without_a_device_one_line_says_so(run_tool, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "cupy", None)
    line = (
        "device: found 'cuda', expected one that can be used: GPU: found no CuPy, expected it: "
        "pip install 'flametomo[gpu]'"
    )
    done = run_tool("benchmark", "--part", "gpu", "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert done.stderr.strip() == f"error: {line}"
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(sys, "argv", ["gpu.py"])
    assert script.main() == 2
    assert capsys.readouterr().out.strip() == line


def test_the_script_tests_and_prints_every_table(cupy, monkeypatch, capsys):
    rows = {name: [{"what": name, "holds": True}] for name in ("errors", "rates")}
    monkeypatch.setattr(script, "run", lambda request: rows)
    monkeypatch.setattr(script, "tested", lambda: 0)
    monkeypatch.setattr(sys, "argv", ["gpu.py", "--size", "tiny"])
    assert script.main() == 0
    printed = capsys.readouterr().out
    assert "Stand-in (cuda:0)" in printed
    assert all(f"**{name}**" in printed for name in rows)
    rows["errors"][0]["holds"] = False
    assert script.main() == 1
