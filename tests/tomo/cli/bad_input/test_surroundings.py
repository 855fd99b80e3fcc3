"""Pipes in place of files, names and environments that terminals and libraries stumble over."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigs import ring, save_rig
from tomo import VoxelGrid
from tomo.io import write_volume

TOOLS = Path(__file__).parents[4] / "tools"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
@pytest.mark.parametrize("name", ["rig.yaml", "transforms.json", "a.npz"])
def test_a_pipe_is_refused_where_a_file_is_read(tmp_path, run_tool, name):
    os.mkfifo(tmp_path / name)
    verb = "visualize-volume" if name == "a.npz" else "check-rig"
    arguments = ("-o", tmp_path / "a.png") if name == "a.npz" else ()
    done = run_tool(verb, tmp_path / name, *arguments)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: {tmp_path / name}: ")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
def test_an_image_that_is_a_pipe(scan, refused):
    image = scan / "images" / "cam01" / "frame_000.tif"
    (image,) = image.parent.iterdir()
    image.unlink()
    os.mkfifo(image)
    try:
        done = refused("reconstruct", scan, "-o", scan.parent / "out")
    finally:
        image.unlink()
    assert f"{image}" in done
    assert "found a pipe or device, expected a file" in done


@pytest.mark.parametrize("name", ["a\x1b[31mb.yaml", "a\u202eb.yaml"])
def test_control_characters_in_names_do_not_reach_the_terminal(tmp_path, run_tool, name):
    done = run_tool("check-rig", tmp_path / name)
    assert done.exit_code == 2
    assert done.stderr.rstrip("\n").isprintable()
    assert "a\\" in done.stderr


def test_a_volume_of_nothing_but_nan_is_not_drawn(tmp_path, refused):
    grid = VoxelGrid((3, 4, 5), 1.0)
    write_volume(tmp_path / "a.npz", np.full((3, 4, 5), np.nan), grid, allow_nan=True)
    line = refused("visualize-volume", tmp_path / "a.npz", "-o", tmp_path / "a.png")
    assert "found NaN in every voxel" in line


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_json_that_cannot_be_written_is_one_line(tmp_path):
    save_rig(ring(3, distance=60.0, image_size=(12, 18), footprint=0.8), tmp_path / "a.yaml")
    command = [sys.executable, TOOLS / "convert_rig.py", "a.yaml", "b.yaml", "--json"]
    with open("/dev/full", "w") as full:
        for stdout in ({"stdout": full}, {"preexec_fn": lambda: os.close(1)}):
            how = {"cwd": tmp_path, "stderr": subprocess.PIPE, "text": True} | stdout
            done = subprocess.run(command, **how)
            assert done.returncode == 1
            (line,) = done.stderr.splitlines()
            assert line.startswith("error: stdout: ")


def test_loops_that_are_not_to_be_compiled_are_refused(monkeypatch, tmp_path, refused):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    line = refused("check-rig", "paper11_22deg")
    assert "NUMBA_DISABLE_JIT: found '1' in the environment" in line


def test_a_terminal_without_columns_shows_what_is_said(monkeypatch, run_tool):
    monkeypatch.setenv("COLUMNS", "0")
    done = run_tool("check-rig", "paper11_22deg")
    assert "paper11_22deg: good" in done.stderr
    assert "cam00" in done.stdout


@pytest.mark.parametrize("address", ["nonsense", "tcp://" + "a" * 5000 + ":8786", ""])
def test_what_is_no_address_of_a_scheduler_is_not_looked_for(scan, refused, address):
    out = scan.parent / "out.zarr"
    line = refused("reconstruct", scan, "--frames", ":", "--scheduler", address, "-o", out)
    assert line.startswith("error: scheduler: found ")
    assert len(line) < 200
