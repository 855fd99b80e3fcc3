import contextlib
import json
import os
import select
import shutil
import subprocess
import time
from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from phantoms import GaussianBlobs
from tomo.grid import VoxelGrid
from tomo.inference import solve
from tomo.measurement import estimate_noise
from tomo.model import Observation
from tomo.operators import Projector
from tomo.rays import Rays
from tomo.series import SeriesStore
from tomo.series.layout import CAMERA_FIGURES
from tomo.series.solving import SKIPPED, FrameResult
from tomo.simulation import simulate_images
from tomo.trace import Segments, trace

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--no-first-run",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--remote-debugging-pipe",
)
FRAMES = 20


@contextlib.contextmanager
def few_iterations_a_solve():
    """Look for what is wrong with cameras in solves of 6 iterations instead of 16.

    The same is looked for, less sharply. Tests of how well the default finds it, those of
    inference, limits and findings, do without this.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solve, "THEN", 6)
        yield


@pytest.fixture(scope="session")
def solve_quickly():
    """Return `few_iterations_a_solve`: ``with solve_quickly(): ...``."""
    return few_iterations_a_solve


@pytest.fixture
def quick_solve():
    """Solves are quick in one test, see `few_iterations_a_solve`."""
    with few_iterations_a_solve():
        yield


@pytest.fixture(scope="module")
def quick_solves():
    """Solves are quick in a whole file of tests, see `few_iterations_a_solve`."""
    with few_iterations_a_solve():
        yield


@pytest.fixture(scope="session")
def lines():
    """Return the projector of 400 lines every which way, in four views, the second without any."""
    grid = VoxelGrid((9, 14, 7), (0.5, 0.4, 0.6), (0.3, -0.2, 0.1))
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((400, 3))
    points = rng.uniform(grid.lower - 0.5, grid.upper + 0.5, (400, 3))
    segments = trace(Rays.from_lines(points - 20 * directions, directions), grid)
    return Projector(segments, grid, [0, 100, 100, 250, 400])


@pytest.fixture(scope="session")
def projector_of():
    """Return a function: dense matrix (pixels, unknowns) to Projector; zeros are not stored."""

    def make(matrix, view_ptr=None, active=None):
        matrix = np.asarray(matrix, np.float64)
        rows, columns = np.nonzero(matrix)
        ptr = np.searchsorted(rows, np.arange(len(matrix) + 1)).astype(np.int64)
        entries = matrix[rows, columns].astype(np.float32)
        segments = Segments(ptr, columns.astype(np.int32), entries)
        grid = active.grid if active else VoxelGrid((matrix.shape[1], 1, 1), 1.0)
        return Projector(segments, grid, view_ptr, active)

    return make


@pytest.fixture(scope="session")
def dense():
    """Return a function: Projector to its dense float64 matrix."""
    return lambda projector: projector.to_scipy().toarray().astype(np.float64)


def _ring_projector(supersample=1):
    grid = VoxelGrid((10, 14, 10), 1.0)
    rig = rigs.ring(9, distance=300.0, image_size=(16, 20), footprint=0.9, pitch_degrees=10.0)
    rays = Rays.concatenate([Rays.from_camera(camera, supersample=supersample) for camera in rig])
    return Projector(trace(rays, grid), grid, np.arange(10) * 320)


@pytest.fixture(scope="session")
def ring_system():
    """Return a smooth flame-like truth in view of nine cameras: projector, truth, measured."""
    projector = _ring_projector()
    x, y, z = np.moveaxis(projector.grid.centers(), -1, 0)
    truth = np.exp(-(((x - 0.7) / 2) ** 2) - (y / 4) ** 2 - ((z + 0.4) / 2.5) ** 2)
    truth = np.where(truth > 0.02, truth, 0).astype(np.float32)
    return SimpleNamespace(projector=projector, truth=truth, measured=projector @ truth.ravel())


@pytest.fixture(scope="session")
def supersampled(ring_system):
    """Return the same truth seen with 3 x 3 rays a pixel: voxels repeat in a pixel's row."""
    projector = _ring_projector(supersample=3)
    return SimpleNamespace(
        projector=projector,
        truth=ring_system.truth,
        measured=projector @ ring_system.truth.ravel(),
    )


@pytest.fixture(scope="session")
def observed():
    """Return what six cameras around three blobs of light observe, and the mean emission."""
    grid = VoxelGrid((12, 16, 12), 1.0)
    field = GaussianBlobs(
        [[1.0, -1.0, -0.6], [-1.5, 2.0, 1.6], [0.6, -3.0, 1.2]], [1.3, 1.2, 0.9], [1.0, 0.8, 0.9]
    )
    rig = rigs.ring(
        6,
        distance=200.0,
        image_size=(36, 48),
        footprint=0.6,
        pitch_degrees=[12.0, -14.0] * 3,
        start_degrees=11.0,  # rays along voxel faces show steps
    )
    made = simulate_images(rig, field, grid, supersample=2, refine=3, noise=0.005)
    images = tuple(made.images.values())
    masks = tuple(np.ones(image.shape, bool) for image in images)
    noise = tuple(map(estimate_noise, images, masks))
    return Observation(rig, images, masks, noise, grid), made.truth


@pytest.fixture(scope="session")
def attributes():
    return {
        "cameras": ["left", "right"],
        "length_unit": "mm",
        "value_unit": "counts per mm",
        "time_unit": "s",
        "plan": {},
        "plan_warnings": [],
        "options": {"hold_out": ["right"], "method": "auto"},
        "versions": {"flametomo": "0.1.0"},
    }


@pytest.fixture(scope="session")
def filled(attributes):
    """Return a function: path, volumes and settings to a store of them, without solving."""

    def make(path, volumes, *, rate=100.0, bad=(), **figures):
        grid = VoxelGrid(volumes[0].shape, (0.5, 1.0, 2.0), (1.0, 0.0, -3.0))
        count = len(volumes)
        times, numbers = np.arange(count) / rate, np.arange(count) + 50
        store = SeriesStore.create(path, grid, times, numbers, attributes)
        results = []
        for place, volume in enumerate(volumes):
            if place in bad:
                results.append(SKIPPED)
                continue
            store.write_volume(place, volume)
            own = {
                "relative_residual": 0.1,
                "total_emission": float(volume.sum()),
                "seconds": 0.25,
                "view_residual": {"left": 0.1, "right": 0.2},
                "view_beyond_noise": {"left": 0.02},
                "view_gain": {"left": 1.0, "right": 1.05},
                "view_light": {"left": 1.0, "right": 1.05},
                "psnr": {"right": 31.0},
                "ssim": {"right": 0.95},
            }
            own |= {name: values[place] for name, values in figures.items()}
            by_camera = {name: own.pop(name) for name in CAMERA_FIGURES if name in own}
            results.append(FrameResult(None, own, by_camera))
        store.finish(range(count), results)
        return store

    return make


@pytest.fixture(scope="session")
def volumes():
    """Return frames of a spot that moves along x, as volumes of unequal sides."""
    x, y, z = np.meshgrid(np.arange(7), np.arange(9), np.arange(5), indexing="ij")
    return [
        np.exp(-((x - 0.3 * time) ** 2) / 4 - (y - 4) ** 2 / 6 - (z - 1) ** 2).astype(np.float32)
        for time in range(FRAMES)
    ]


@pytest.fixture(scope="session")
def film_store(filled, volumes, tmp_path_factory):
    """Return a store whose frame 54, in place 4, could not be read."""
    return filled(tmp_path_factory.mktemp("store") / "out.zarr", volumes, bad=(4,))


class Browser:
    """One browser without a display, spoken to in Chrome's DevTools protocol over two pipes.

    `command` sends one command and returns its answer.
    """

    def __init__(self, program, profile):
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()

        def pipes_at_3_and_4():
            os.dup2(theirs_in, 63)  # 3 or 4 may be what is moved
            os.dup2(theirs_out, 64)
            os.dup2(63, 3)
            os.dup2(64, 4)
            os.set_inheritable(3, True)
            os.set_inheritable(4, True)

        self._process = subprocess.Popen(
            [program, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=False,
            preexec_fn=pipes_at_3_and_4,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._number, self._buffer, self._session = 0, b"", None
        self.events = []
        target = self.command("Target.createTarget", url="about:blank")["targetId"]
        attached = self.command("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.command(f"{domain}.enable")

    def command(self, method, seconds=60, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + seconds
        while True:
            answer = self._receive(until - time.monotonic(), method)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def evaluate(self, script):
        """Return what the body of an async function returns in the page."""
        answer = self.command(
            "Runtime.evaluate",
            expression=f"(async () => {{ {script} }})()",
            awaitPromise=True,
            returnByValue=True,
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    @contextlib.contextmanager
    def without_webgl(self):
        """Open pages as a browser does that has no WebGL2."""
        source = "HTMLCanvasElement.prototype.getContext = () => null;"
        added = self.command("Page.addScriptToEvaluateOnNewDocument", source=source)
        try:
            yield
        finally:
            self.command("Page.removeScriptToEvaluateOnNewDocument", **added)

    def problems(self):
        """Return what the page's console and network reported as errors, and forget it."""
        events, self.events = self.events, []
        found = []
        for event in events:
            method, parameters = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(json.dumps(parameters["exceptionDetails"])[:500])
            elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
                found.append(parameters["entry"]["text"])
            elif method == "Runtime.consoleAPICalled" and parameters["type"] in (
                "error",
                "assert",
            ):
                found.append(json.dumps(parameters["args"])[:500])
        return found

    def close(self):
        self._process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(10)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        os.close(self._out)
        os.close(self._in)

    def _receive(self, seconds, method):
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], max(seconds, 0))
            assert ready, f"no answer to {method}"
            part = os.read(self._in, 1 << 20)
            assert part, f"the browser ended at {method}"
            self._buffer += part
        message, self._buffer = self._buffer.split(b"\0", 1)
        return json.loads(message)


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: found none of {', '.join(BROWSERS)}")
    if not hasattr(os, "fork"):
        pytest.skip("the browser is spoken to over inherited pipes, which this system has not")
    opened = Browser(program, tmp_path_factory.mktemp("browser"))
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def open_page(browser):
    """Return a function that opens a page of ours by its path or address, ready to be used.

    Pages with a script say when they are; others are when they are loaded.
    """

    def opened(path, size=(1400, 900)):
        browser.command(
            "Emulation.setDeviceMetricsOverride",
            width=size[0], height=size[1], deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        url = path if isinstance(path, str) else path.as_uri()
        browser.command("Page.navigate", url=url)
        browser.evaluate(
            "window.pause = (ms) => new Promise((done) => setTimeout(done, ms));"
            "window.ready = () => document.readyState === 'complete'"
            "  && (document.body.dataset.ready || !document.scripts.length);"
            "for (let k = 0; k < 600 && !window.ready(); k++) await pause(50);"
            "window.frame = () => new Promise((done) => requestAnimationFrame(done));"
            "window.until = async (is) => {"
            "  for (let k = 0; k < 300 && !is(); k++) await pause(20); };"
            "window.settled = async () => { await frame(); await frame(); await pause(50); };"
            "await settled();"
        )
        return browser

    return opened


@pytest.fixture(autouse=True)
def no_console_errors(request):
    """Fail a test in whose pages the console reported an error."""
    yield
    if "open_page" in request.fixturenames:
        assert request.getfixturevalue("browser").problems() == []


@pytest.fixture(scope="session")
def disturbed(run_tool):  # which has tools/ on the path
    """Return `studies.common.scans.disturbed`: cameras a little elsewhere than they should be."""
    from studies.common.scans import disturbed

    return disturbed
