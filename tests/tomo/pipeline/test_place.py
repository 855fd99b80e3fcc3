"""Where products are computed: the device that is asked for, or the CPU and why."""

import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from host_build import CompileException

from tomo import load_scan
from tomo.model import Observation
from tomo.operators import Absorption, LinearSystem
from tomo.operators.gpu import wanted
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.methods import method_named
from tomo.pipeline.place import at_device, training_device

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

STAND_IN = "computed on Stand-in (cuda:0)"


QUICK = {"screen": False, "refine_cameras": "none", "fit_gain": False, "uncertainty": 0}


def of(folder, **settings):
    options = Options(**QUICK, fit_absorption=False, **settings)
    return reconstruct(load_scan(folder), options=options)


@pytest.mark.parametrize(
    "settings",
    [
        {"projector": "on-the-fly", "basis": "linear"},
        {"method": "mlem", "iterations": 8, "absorption": 0.02, "projector": "on-the-fly"},
        {"method": "sart", "iterations": 4, "hold_out": "cam01"},
    ],
    ids=["linear", "gas", "sart"],
)
def test_a_volume_is_that_of_the_cpu_and_says_where_it_was_computed(folder, cupy, far, settings):
    own, there = of(folder, **settings), of(folder, device="cuda", **settings)
    assert own.report()["projector"]["device"] == "computed on the CPU"
    assert there.report()["projector"]["device"] == STAND_IN
    assert "--fmad=false" in cupy.options
    assert far(there.volume, own.volume) < 1e-4
    assert there.report()["settings"]["device"] == "cuda"


def test_findings_volume_and_intervals_are_those_of_the_cpu(folder, cupy, far, monkeypatch):
    scan = load_scan(folder)
    devices, placed = [], Observation.placed

    def noted(observation, system):
        devices.append(observation.device)
        return placed(observation, system)

    monkeypatch.setattr(Observation, "placed", noted)
    own = reconstruct(scan, options=Options())
    assert not any(devices)
    there = reconstruct(scan, options=Options(device="cuda"))
    assert any(devices)
    reports = [one.report() for one in (own, there)]
    said = [[(f["effect"], f["camera"]) for f in one["findings"]] for one in reports]
    assert said[0] == said[1]
    assert far(there.volume, own.volume) < 1e-4
    widths = [one["uncertainty"]["intervals"]["voxels"]["median_half_width"] for one in reports]
    assert widths[1] == pytest.approx(widths[0], rel=1e-2)


def test_auto_takes_a_device_where_the_problem_is_worth_it(folder, cupy, monkeypatch):
    quick = {"method": "sirt", "iterations": 2, "device": "auto"}
    place = of(folder, **quick).report()["projector"]["device"]
    assert re.fullmatch(
        r"[\d.e+]+ segments times iterations, a GPU pays from 5e\+09: computed on the CPU", place
    )
    monkeypatch.setattr(wanted, "WORTH", 1.0)
    assert of(folder, **quick).report()["projector"]["device"] == STAND_IN
    monkeypatch.setitem(sys.modules, "cupy", None)
    place = of(folder, **quick).report()["projector"]["device"]
    assert place.startswith("GPU: found no CuPy, expected it: pip install 'flametomo[gpu]': ")


@pytest.fixture
def system(folder):
    scan = load_scan(folder)
    return LinearSystem.from_rig(scan.rig, scan.grid)


def test_methods_that_go_through_entries_stay_on_the_cpu(system, cupy):
    for name, device in (("art", "auto"), ("wernet", "cuda"), ("art", "cpu")):
        methods = [method_named("sirt"), method_named(name)]
        same, place = at_device(system, Options(device=device), methods)
        assert same is system
        reason = "" if device == "cpu" else f"{name} goes through the matrix's entries: "
        assert place == f"{reason}computed on the CPU"


def test_a_film_is_worth_a_device(system, cupy):
    options = Options(device="auto", frames=":")
    assert at_device(system, options, [method_named("auto")])[1] == STAND_IN


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_gas_is_changed_on_the_device(folder, cupy, form):
    """Gas that absorbs its own light changes after the equations went there."""
    scan = load_scan(folder)
    own = LinearSystem.from_rig(scan.rig, scan.grid, form=form).with_linear_basis()
    there, _ = at_device(own, Options(device="cuda"), [method_named("mlem")])
    volume = np.random.default_rng(0).random(scan.grid.shape, np.float32)
    x = volume.ravel()
    for gas in (Absorption(0.02), Absorption(0.0, 0.1), Absorption()):
        here = own.with_absorption(gas, volume).projector @ x
        there = there.with_absorption(gas, volume)
        assert there.projector.device.name == "Stand-in (cuda:0)"
        np.testing.assert_allclose(there.projector @ x, here, rtol=1e-5, atol=1e-5 * here.max())
        back = there.projector.on_cpu @ x
        np.testing.assert_allclose(back, here, rtol=1e-5, atol=1e-5 * here.max())


def refused(folder, **settings):
    with pytest.raises(ValueError, match=r"^device: found 'cuda', expected ") as caught:
        of(folder, device="cuda", **settings)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_a_device_asked_for_by_name_that_lacks_something_is_refused_before_the_work(
    folder, cupy, monkeypatch
):
    ready = "device: found 'cuda', expected one that can be used: GPU: "
    assert refused(folder, method="art").endswith(
        "cpu or auto for method art: it goes through the matrix's entries one by one"
    )
    monkeypatch.setattr(cupy.cuda.runtime, "memGetInfo", lambda: (200_000, 1 << 40))
    assert re.fullmatch(
        rf"{ready}Stand-in \(cuda:0\): \d\.\d\d GB needed and 0.00 GB free; \d+ voxels would fit, "
        r"found 2000",
        refused(folder, method="sirt"),
    )

    def broken(code, options):
        raise CompileException('\nkernels.cu(7): error: identifier "whole" is undefined\n1 error')

    monkeypatch.setattr(cupy, "RawModule", broken)
    line = 'kernels do not compile: kernels.cu(7): error: identifier "whole" is undefined'
    assert refused(folder) == f"{ready}{line}"

    def old():
        raise RuntimeError("cudaErrorInsufficientDriver: CUDA driver version is insufficient")

    cupy.cuda = SimpleNamespace(runtime=SimpleNamespace(getDeviceCount=old))
    assert "found no CUDA device: cudaErrorInsufficientDriver: " in refused(folder)
    monkeypatch.setitem(sys.modules, "cupy", None)
    assert refused(folder).endswith("found no CuPy, expected it: pip install 'flametomo[gpu]'")


def test_a_number_names_one_of_several_devices(folder, cupy):
    with pytest.raises(ValueError, match=r"GPU: found no device 3, expected 0 to 0$"):
        of(folder, device="cuda:3")
    with pytest.raises(ValueError, match="device: found 'gpu', expected cpu, auto, cuda or cuda:"):
        Options(device="gpu")


def test_wernet_trains_where_auto_finds_a_device(monkeypatch):
    import torch

    for there, expected in ((True, "cuda"), (False, "cpu")):
        monkeypatch.setattr(torch.cuda, "is_available", lambda: there)  # noqa: B023
        assert training_device("auto") == expected
    assert training_device("cuda:1") == "cuda:1"


class Lost(Exception):  # noqa: N818
    """What CuPy raises where a device is gone."""


Lost.__module__ = "cupy_backends.cuda.api.runtime"


def test_a_device_lost_in_the_middle_ends_the_run_in_one_line(
    folder, cupy, run_tool, tmp_path, monkeypatch
):
    launch, launched = cupy.host.launch, []

    def failing(*arguments):
        launched.append(arguments[0])
        if len(launched) > 60:
            raise Lost("cudaErrorUnknown: unknown error")
        launch(*arguments)

    monkeypatch.setattr(cupy, "host", SimpleNamespace(launch=failing))
    asked = ("--method", "cgls", "--no-screen", "--refine-cameras", "none", "--device", "cuda")
    done = run_tool("reconstruct", folder, *asked, "-o", tmp_path / "out")
    assert done.exit_code == 1
    (line,) = [one for one in done.stderr.splitlines() if one.startswith("error")]
    assert line == "error: GPU: Stand-in (cuda:0): cudaErrorUnknown: unknown error"
    assert not list((tmp_path / "out").glob("volume*"))
