"""The set-up of the scripts, run against a stand-in for Python that records its calls."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SCRIPTS = sorted(TOOLS.glob("*.sh"))

# As Python: its version suffices; `-m venv` makes .venv with itself; the rest it only records.
# It also stands in for flametomo.
FAKE_PYTHON = """#!/bin/sh
echo "$*" | head -n 1 >>"$CALLS"
case "$*" in
  *version_info\\ \\<*) exit "${OLD:-0}" ;;
  *"import ensurepip, venv"*) exit "${NO_VENV:-0}" ;;
  *"%d.%d"*) echo 3.11 ;;
  *"-m venv"*) mkdir -p .venv/bin
    cp "$FAKE" .venv/bin/python; cp "$FAKE" .venv/bin/flametomo ;;
  *"-m pip"*) exit "${NO_PIP:-0}" ;;
  *ctypes*) for package in $MISSING; do echo "$package"; done ;;
esac
"""
FAKE_ID = "#!/bin/sh\necho ${FAKE_UID:-1000}\n"
FAKE_APT = '#!/bin/sh\necho "apt-get $*" >>"$CALLS"\nexit "${NO_APT:-0}"\n'


@pytest.fixture
def project(tmp_path):
    """Return a function that runs a script of a project of its own, and the file of calls."""
    root = tmp_path / "a project"
    (root / "tools").mkdir(parents=True)
    for script in SCRIPTS:
        shutil.copy(script, root / "tools")
    for name in ("setup.cfg", "pyproject.toml", "constraints.txt"):
        (root / name).write_text("")
    commands = tmp_path / "commands"
    commands.mkdir()
    for name, text in [("python3.11", FAKE_PYTHON), ("id", FAKE_ID), ("apt-get", FAKE_APT)]:
        (commands / name).write_text(text)
        (commands / name).chmod(0o755)
    for name in ["sh", "cat", "cksum", "cp", "dirname", "head", "mkdir", "rm", "uname"]:
        (commands / name).symlink_to(shutil.which(name))
    calls = tmp_path / "calls"

    def run(script="test.sh", *arguments, **variables):
        calls.write_text("")
        env = {"PATH": str(commands), "CALLS": str(calls), "FAKE": str(commands / "python3.11")}
        done = subprocess.run(
            [shutil.which("sh"), f"tools/{script}", *arguments],
            cwd=root,
            env=env | variables,
            capture_output=True,
            text=True,
        )
        return done, calls.read_text()

    run.root, run.commands = root, commands
    return run


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_the_scripts_parse(script):
    subprocess.run(["sh", "-n", script], check=True)


def test_set_up_then_tests_with_the_arguments(project):
    done, calls = project("test.sh", "tests/rigs", "-x")
    assert done.returncode == 0, done.stderr
    assert "-m venv --clear .venv" in calls
    assert "-m pip install -q -c constraints.txt -e .[dev]" in calls
    assert calls.splitlines()[-1] == "-m pytest tests/rigs -x"


def test_the_second_time_installs_nothing_until_the_pins_change(project):
    project()
    done, calls = project()
    assert done.returncode == 0
    assert "-m venv" not in calls
    assert "-m pip" not in calls
    (project.root / "constraints.txt").write_text("numpy==2\n")
    assert "-m pip install" in project()[1]


def test_only_the_site_installs_what_the_site_needs(project):
    assert "-e .[dev]\n" in project("demo.sh")[1]
    done, calls = project("docs.sh")
    assert done.returncode == 0, done.stderr
    assert "-e .[dev,docs]\n" in calls
    assert "-m sphinx" in calls
    for script in ("docs.sh", "test.sh", "demo.sh"):
        assert "-m pip" not in project(script)[1], script


def test_missing_libraries_are_installed_by_root(project):
    done, calls = project(MISSING="libgl1 libusb-1.0-0", FAKE_UID="0")
    assert done.returncode == 0, done.stderr
    assert "apt-get update" in calls
    assert "apt-get install -q -y libgl1 libusb-1.0-0" in calls


def test_missing_libraries_are_named_to_others(project):
    done, calls = project(MISSING="libgl1 libusb-1.0-0")
    assert done.returncode == 2
    assert "run: sudo apt-get install -y libgl1 libusb-1.0-0" in done.stderr
    assert "apt-get" not in calls


@pytest.mark.parametrize("who", [{}, {"FAKE_UID": "0", "NO_APT": "1"}], ids=["user", "offline"])
def test_without_a_browser_the_other_tests_run(project, who):
    done, calls = project("test.sh", **who)
    assert done.returncode == 0, done.stderr
    assert "the tests of HTML pages are skipped" in done.stderr
    assert calls.splitlines()[-1] == "-m pytest"


def test_the_demo_simulates_reconstructs_and_names_its_files(project):
    done, calls = project("demo.sh")
    assert done.returncode == 0, done.stderr
    verbs = [line.split()[0] for line in calls.splitlines() if "out/demo" in line]
    assert verbs[:2] == ["simulate", "reconstruct"]
    assert {"visualize-rig", "visualize-volume"} <= set(verbs)
    assert len(verbs) == 4
    assert "wernet-paper" not in calls
    assert "import runpy" in calls
    for file in ("report.html", "learned.png"):
        assert f"out/demo/{file}" in done.stderr
    (example,) = re.findall(r"docs/examples/\w+\.py", (TOOLS / "demo.sh").read_text())
    assert (TOOLS.parent / example).is_file()


@pytest.mark.parametrize(
    ("lack", "words"),
    [
        ({"NO_PIP": "1"}, "pip could not install"),
        ({"OLD": "1"}, "no Python 3.11 or newer"),
        ({"NO_VENV": "1"}, "sudo apt-get install -y python3.11-venv"),
    ],
)
def test_what_is_missing_is_said(project, lack, words):
    done, _ = project(**lack)
    assert done.returncode == 2
    assert words in done.stderr
    assert "-m pip install" in project()[1]  # it is done again
