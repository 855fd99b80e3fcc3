"""Progress: silent, a callable, or a bar in a terminal and in a notebook."""

import io
import itertools
import re

import pytest
from rich.console import Console

import rigs.progress
from rigs.progress import FRAMES, WHOLE, clock, progress_of, stage_of, staged


def shown(monkeypatch, name, calls, **how):
    """Return what a bar shows of some calls."""
    file = io.StringIO()
    console = Console(file=file, width=120, **how)
    monkeypatch.setattr(rigs.progress, "stderr", lambda: console)
    with progress_of(True, name) as tell:
        for call in calls:
            tell(*call)
    return file.getvalue()


@pytest.mark.parametrize("silent", [None, False])
def test_it_is_silent_by_default(silent, capsys):
    with progress_of(silent, "trace") as tell:
        assert tell is None
    assert capsys.readouterr() == ("", "")


def test_a_callable_is_called():
    steps = []
    with progress_of(lambda *step: steps.append(step), "trace") as tell:
        tell(1, 3, "cam00")
    assert steps == [(1, 3, "cam00")]


def test_what_is_neither_is_refused():
    with (
        pytest.raises(ValueError, match="progress: found 'yes', expected True, None"),
        progress_of("yes", "trace"),
    ):
        pass


TERMINAL = {"force_terminal": True, "color_system": None, "_environ": {"TERM": "xterm"}}


def lines_of(text):
    """Return the lines that a terminal shows at the end."""
    last = re.split(r"\x1b\[\d?A", text)[-1]
    plain = re.sub(r"\x1b\[[?0-9;]*[A-Za-z]", "", last).replace("\r", "")
    return [line for line in plain.splitlines() if line.strip()]


def test_a_bar_has_its_name_the_part_done_and_the_step(monkeypatch):
    line = lines_of(shown(monkeypatch, "trace", [(1, 4, "cam00")], **TERMINAL))[-1]
    assert line.startswith("trace")
    assert "25 %" in line
    assert line.rstrip().endswith("cam00")


def test_stages_have_lines_of_their_own_before_the_frames(monkeypatch):
    calls = [(0, 0, "plan: tracing"), (1, 5, "plan: tracing: cam01"), (3, 3, "frame 2")]
    first, second = lines_of(shown(monkeypatch, FRAMES, calls, **TERMINAL))[-2:]
    assert first.startswith("tracing")
    assert second.startswith("frames")
    assert "3 in 0:00" in second


def test_without_a_terminal_parts_are_counted_at_the_end(monkeypatch):
    first, last = shown(monkeypatch, FRAMES, [(n, 3, f"frame {n}") for n in range(4)]).splitlines()
    assert first == "frames 0:00: 0%, frame 0"
    assert last == "frames 0:00: 3 in 0:00"


def test_without_a_terminal_each_stage_has_a_line_and_few_more(monkeypatch):
    now = itertools.count(0, 4)  # seconds, at each call
    monkeypatch.setattr(rigs.progress.time, "monotonic", lambda: next(now))
    calls = [(0, 0, "plan: tracing"), *((n, 8, f"plan: choosing: setting {n}") for n in range(8))]
    lines = shown(monkeypatch, "reconstruct", calls).splitlines()
    assert lines == [
        "reconstruct 0:04: tracing",
        "reconstruct 0:08: choosing, setting 0",
        "reconstruct 0:20: choosing, 38%, setting 3",
        "reconstruct 0:32: choosing, 75%, setting 6",
    ]


def test_the_whole_is_told_below_its_stages(monkeypatch):
    calls = [
        (0, 1, "plan: tracing"),
        (20, 80, WHOLE),
        (0, 1, "plan: solve"),
        (1, 4, "plan: solve: 5"),
        (50, 100, WHOLE),
    ]
    first, second, last = lines_of(shown(monkeypatch, "reconstruct", calls, **TERMINAL))[-3:]
    assert first.startswith("tracing")
    assert "100 %" in first
    assert second.startswith("solve")  # it is over, as all is
    assert "100 %" in second
    assert last.startswith("reconstruct")
    assert "50 %, 0:05 left" in last


def test_without_a_terminal_each_line_tells_of_the_whole(monkeypatch):
    calls = [(0, 1, "plan: tracing"), (20, 80, WHOLE), (0, 1, "plan: solve")]
    first, last = shown(monkeypatch, "reconstruct", calls).splitlines()
    assert first == "reconstruct 0:00: tracing"
    assert last == "reconstruct 0:00 (25 %, 0:06 left): solve"


def test_a_bar_goes_to_stderr(capsys):
    rigs.progress.stderr.cache_clear()
    with progress_of(True, "trace") as tell:
        tell(1, 2, "")
    rigs.progress.stderr.cache_clear()
    out, err = capsys.readouterr()
    assert out == ""
    assert "trace" in err


def test_a_stage_is_told_by_how_a_step_begins():
    steps = []
    tell = staged(lambda *step: steps.append(step))("carving")
    tell(2, 3, "cam01")
    assert [stage_of(step) for _, _, step in steps] == [("carving", ""), ("carving", "cam01")]
    assert staged(None)("carving") is None


def test_a_notebook_shows_the_bar_as_html(monkeypatch):
    interactive = pytest.importorskip("IPython.core.interactiveshell")
    pytest.importorskip("ipywidgets")
    from IPython.utils.capture import capture_output

    shell = interactive.InteractiveShell.instance()
    console = Console(stderr=True, force_jupyter=True, width=100)
    monkeypatch.setattr(rigs.progress, "stderr", lambda: console)
    try:
        with capture_output() as captured, progress_of(True, "trace") as tell:
            tell(1, 4, "cam00")
        assert captured.outputs
        assert captured.stdout == ""
    finally:
        shell.clear_instance()


@pytest.mark.parametrize(("seconds", "words"), [(65, "1:05"), (7500, "2 h 05")])
def test_times_in_words(seconds, words):
    assert clock(seconds) == words
