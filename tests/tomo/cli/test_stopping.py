"""Ctrl-C and SIGTERM at every moment of a command's life: one line, or a result that is whole."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from rigs import ring, save_rig

ROOT = Path(__file__).parents[3]
TOOLS = ROOT / "tools"
COMMANDS = sorted(TOOLS.glob("*.py"))

COMMAND = """
import os, sys, time

from tomo.cli.stopping import run

stop = lambda: os.kill(os.getpid(), {number})

{text}

run(app)
"""

SIGNALS = pytest.mark.parametrize(
    ("number", "code", "line"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
    ids=["ctrl-c", "sigterm"],
)


@pytest.fixture(autouse=True)
def ctrl_c_counts():
    """Have what the tests start hear Ctrl-C: who starts them in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def _python(*arguments, hooks=None, **variables):
    """Run Python; ``hooks`` is a folder with what it runs first, as ``sitecustomize``."""
    paths = [path for path in (hooks, TOOLS, ROOT) if path]
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))} | variables,
        capture_output=True,
        text=True,
        timeout=60,
    )
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith("simulate ")]
    return done.returncode, lines, done.stdout


@pytest.fixture
def command(tmp_path):
    """Return a function that runs a command whose module is the text given."""

    def run(text, number):
        path = tmp_path / "a_command.py"
        path.write_text(COMMAND.format(number=int(number), text=textwrap.dedent(text)))
        return _python(path)[:2]

    return run


def test_every_command_listens_before_it_imports():
    """What a file in tools/ imports at its top is our own, and loads no library."""
    paths = list(map(str, COMMANDS))
    code = f"import runpy, sys; [*map(runpy.run_path, {paths})]; print(*sys.modules)"
    code_of_process, lines, loaded = _python("-c", code)
    assert (code_of_process, lines) == (0, [])
    late = ("typer", "rich", "numpy", "rigs", "phantoms")
    loaded = {name for name in loaded.split() if name.split(".")[0] in late}
    assert loaded <= {"rigs", "rigs.lazy_names"}  # what `import tomo` itself takes


MOMENTS = {
    "working": "def app(): stop(), time.sleep(30)",
    "where errors are swallowed": """
        def app():
            try:
                stop()
            except BaseException:
                pass
            time.sleep(30)
        """,
    "beside threads that work on": """
        def app():
            from concurrent.futures import ThreadPoolExecutor

            ThreadPoolExecutor(1).submit(time.sleep, 30)
            stop()
        """,
    "as it ends": """
        def app():
            try:
                sys.exit()
            finally:
                stop()
        """,
}


@SIGNALS
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_stop_is_one_line(command, moment, number, code, line):
    assert command(MOMENTS[moment], number) == (code, [line])


HALF_WRITTEN = {
    "a folder": """
        def app():
            from rigs.files import whole_folder

            with whole_folder({path!r}, []) as staging:
                (staging / "a").write_text("whole")
                stop(), time.sleep(30)
        """,
    "a file of a thread": """
        def app():
            from concurrent.futures import ThreadPoolExecutor
            from rigs.files import atomic_path

            def write():
                with atomic_path({path!r}) as temporary:
                    temporary.write_text("half")
                    time.sleep(30)

            ThreadPoolExecutor(1).submit(write)
            time.sleep(0.3)
            stop()
        """,
}


@SIGNALS
@pytest.mark.parametrize("what", HALF_WRITTEN)
def test_what_is_half_written_is_removed(command, tmp_path, what, number, code, line):
    out = tmp_path / "out"
    out.mkdir()
    path = out if what == "a folder" else out / "file.txt"
    assert command(HALF_WRITTEN[what].format(path=str(path)), number) == (code, [line])
    assert list(out.iterdir()) == []


@SIGNALS
@pytest.mark.parametrize("result", [0, 1])
def test_what_is_done_is_done(command, result, number, code, line):
    text = f"import atexit\natexit.register(stop)\napp = lambda: sys.exit({result})"
    assert command(text, number) == (result, [])


def test_in_the_background_ctrl_c_stays_ignored(command):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert command("def app(): stop(), sys.exit(5)", signal.SIGINT) == (5, [])
    assert command("def app(): stop(), sys.exit(5)", signal.SIGTERM) == (143, ["terminated"])


CALLS = """
import atexit, os, sys

count, moment, heard = 0, int(os.environ["MOMENT"]), False


def call(frame, event, argument):
    global count, heard
    if event == "call":
        code = frame.f_code
        heard = heard or (code.co_name == "run" and code.co_filename.endswith("stopping.py"))
        count += heard
        if count == moment:
            os.kill(os.getpid(), int(os.environ["SIGNAL"]))


atexit.register(lambda: open(os.environ["COUNT"], "w").write(str(count)))
sys.setprofile(call)
"""


def test_a_command_stops_at_any_of_its_calls(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(CALLS)
    rig, out = tmp_path / "rig.yaml", tmp_path / "out" / "opencv.yaml"
    save_rig(ring(2, 60.0, image_size=(8, 6), footprint=0.8), rig)

    def run(moment, number):
        asked = {"MOMENT": str(moment), "SIGNAL": str(int(number)), "COUNT": f"{tmp_path}/count"}
        return _python(TOOLS / "convert_rig.py", rig, out, hooks=tmp_path, **asked)

    done, _, _ = run(-1, 0)
    assert done == 0
    whole, calls = out.read_bytes(), int((tmp_path / "count").read_text())
    assert calls > 10_000
    stopped = 0
    for share in (0.0005, 0.03, 0.3, 0.7, 0.95, 0.998):
        out.unlink(missing_ok=True)
        number = signal.SIGTERM if stopped % 2 else signal.SIGINT
        code, lines, _ = run(max(2, round(share * calls)), number)
        if code:
            assert (code, lines) in [(130, ["interrupted"]), (143, ["terminated"])]
            stopped += 1
        left = [path.read_bytes() for path in out.parent.glob("*")]
        assert left == [whole] or (code and not left)
    assert stopped >= 4


MOVES = """
import os

replace, left = os.replace, [int(os.environ["MOVES"])]


def stop(source, target, **options):
    replace(source, target, **options)
    left[0] -= ".partial-" not in str(target)
    if left[0] == 0:
        os.kill(os.getpid(), int(os.environ["SIGNAL"]))


os.replace = stop
"""


def test_a_stop_while_results_are_moved_leaves_a_whole_one(run_tool, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(MOVES)
    rig, out = tmp_path / "rig.yaml", tmp_path / "scan"
    save_rig(ring(2, 60.0, image_size=(8, 6), footprint=0.8), rig)
    options = ("--rig", rig, "--phantom", "blobs", "--grid", "6x10x6", "--spacing", 1, "-o", out)

    def files():
        paths = [path for path in out.rglob("*") if path.is_file()]
        return {path.relative_to(out): path.read_bytes() for path in paths}

    def left_by(seed):
        assert run_tool("simulate", *options, "--seed", seed).exit_code == 0
        return files()

    whole, other = left_by(2), left_by(1)
    assert whole.keys() == other.keys()
    assert whole != other
    for seed, moves, number, expected in (
        (1, 1, signal.SIGINT, other),
        (2, len(whole), signal.SIGTERM, whole),
    ):
        asked = {"MOVES": str(moves), "SIGNAL": str(int(number))}
        simulate = (TOOLS / "simulate.py", *options, "--seed", seed)
        code, lines, _ = _python(*simulate, hooks=tmp_path, **asked)
        assert (code, lines) in [(0, []), (130, ["interrupted"]), (143, ["terminated"])]
        assert files() == expected
