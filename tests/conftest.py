import importlib.util
import os
import sys
import tracemalloc
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext
from pathlib import Path

import hypothesis
import pytest
from typer.testing import CliRunner

# Before numpy and torch are loaded: on small matrices BLAS's threads spin longer than they work,
# five times the processor time of a calibration, and the tests already run on all cores.
for pool in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

ROOT = Path(__file__).resolve().parent.parent
sys.path += [str(ROOT / "tests/tomo/operators/gpu"), str(ROOT / "tests/fuzz"), str(ROOT / "tools")]
from host_build import (  # noqa: E402
    cuda,  # noqa: F401
    cupy,  # noqa: F401
    host,  # noqa: F401
    libraries,  # noqa: F401
    on_arrays_of,  # noqa: F401
    shuffled,  # noqa: F401
)
from promptness import takes_less_than  # noqa: E402

SECONDS = 2.0  # of processor time for a reader's refusal of one small file
MEMORY = 260 << 20  # bytes that a refusal may take: twice what the size guard allows to any file

# Examples differ from run to run only where a test asks for it: a failure is a failure of the code
hypothesis.settings.register_profile("project", deadline=None, derandomize=True, max_examples=25)
# For hours of a developer's machine: python -m pytest tests/fuzz --hypothesis-profile=long
hypothesis.settings.register_profile("long", deadline=None, max_examples=5000)
hypothesis.settings.load_profile("project")


@contextmanager
def one_ray_a_pixel():
    """Draw scenes without smoothed edges: these take most of a small run's time."""
    from tomo.draw import raster, still

    def coarse(scene, viewpoint, **options):
        return raster.render(scene, viewpoint, 1, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(still, "render", coarse)
        yield


@pytest.fixture
def coarse_scenes():
    """Scenes are drawn with one ray a pixel, see `one_ray_a_pixel`."""
    with one_ray_a_pixel():
        yield


@contextmanager
def one_fold_a_choice():
    """Choose priors by one fold instead of up to eight: choosing takes most of a small run's time.

    The same choices are weighed. Tests of how well one is chosen do without this.
    """
    from tomo.selection import choose

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choose, "ENOUGH_BLOCKS", 1)
        yield


@pytest.fixture(scope="module")
def quick_choices():
    """Priors are chosen quickly in a whole file of tests, see `one_fold_a_choice`."""
    with one_fold_a_choice():
        yield


@pytest.fixture
def quick_choice():
    """Priors are chosen quickly in one test, see `one_fold_a_choice`."""
    with one_fold_a_choice():
        yield


@pytest.fixture(scope="session")
def choose_quickly():
    """Return `one_fold_a_choice`: ``with choose_quickly(): ...``."""
    return one_fold_a_choice


@pytest.fixture(scope="session")
def as_given():
    """Return the options under which images and rig are taken as they are.

    Looking for what is wrong with them takes four fifths of a small run's time.
    """
    return {
        "screen": False,
        "refine_cameras": "none",
        "fit_gain": False,
        "fit_absorption": False,
        "uncertainty": 0,
    }


@contextmanager
def number_of_threads(count):
    """Run kernels on so many threads, or as many as there are, and torch where it is loaded."""
    import numba

    both = [module for module in (numba, sys.modules.get("torch")) if module]
    before = [module.get_num_threads() for module in both]
    try:
        for module in both:
            most = numba.config.NUMBA_NUM_THREADS if module is numba else count
            module.set_num_threads(min(count, most))
        yield
    finally:
        for module, threads in zip(both, before, strict=True):
            module.set_num_threads(threads)


@pytest.fixture(scope="session", autouse=True)
def one_thread_a_worker():
    """Run kernels on one thread where several files of tests run at a time: a fifth faster."""
    with number_of_threads(1) if "PYTEST_XDIST_WORKER" in os.environ else nullcontext():
        yield


@pytest.fixture(scope="session")
def on_threads():
    """Return `number_of_threads`: ``with on_threads(2): ...``."""
    return number_of_threads


class ArtistHere(nullcontext):
    """In place of `tomo.report.Artist`: calls functions at once, in this process."""

    def __enter__(self):
        return self

    def ask(self, function, *values, then=lambda found: None):
        done = Future()
        done.set_result(function(*values))
        then(done.result())
        return done


@pytest.fixture(scope="session")
def run_tool():
    """Return a function that runs ``flametomo VERB`` or ``tools/NAME.py`` in this process.

    ``run_tool("simulate", "--rig", path)`` returns exit_code, stdout and stderr; scenes are drawn
    with one ray a pixel, see `one_ray_a_pixel`, and in this process, which has loaded its
    libraries.
    """
    from tomo.cli.app import VERBS, app

    sys.path.append(str(ROOT / "tools"))

    def run(name, *arguments):
        with one_ray_a_pixel(), pytest.MonkeyPatch.context() as patch:
            patch.setattr("tomo.report.Artist", ArtistHere)
            if (verb := name.replace("_", "-")) in VERBS:
                return CliRunner().invoke(app, [verb, *map(str, arguments)])
            spec = importlib.util.spec_from_file_location(
                f"tool_{name}", ROOT / "tools" / f"{name}.py"
            )
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            return CliRunner().invoke(module.app(), list(map(str, arguments)))

    yield run
    sys.path.remove(str(ROOT / "tools"))


@pytest.fixture(scope="session")
def test_data():
    """Return the folder of real image sets, or skip: it is no part of the project."""
    folder = Path(os.environ.get("TOMO_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real image sets at {folder}; TOMO_TEST_DATA names another folder")
    return folder


@pytest.fixture
def refused(tmp_path):
    """Return a function that reads a hostile file and returns the one line of the refusal.

    ``refused(read, name, content)`` writes the file first; nothing may be read but that file.
    """

    def run(read, name, content):
        path = tmp_path / name
        path.write_bytes(content)
        tracemalloc.start()
        try:
            with takes_less_than(SECONDS), pytest.raises((ValueError, OSError)) as caught:
                read(path)
            taken = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        line = str(caught.value)
        assert line.startswith(f"{path}: ")
        assert "\n" not in line
        assert taken < MEMORY + 4 * len(content)
        assert "allocate" not in line  # nor was the memory asked for and refused
        return line.removeprefix(f"{path}: ")

    return run
