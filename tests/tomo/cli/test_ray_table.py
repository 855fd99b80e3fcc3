"""Rigs with a table of rays through the commands, as any other."""

import json
from dataclasses import replace

import numpy as np
import pytest

from phantoms import create
from rigs import RayTable, load_rig, ring
from tomo import VoxelGrid
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((10, 14, 10), 1.0)


@pytest.fixture
def scan(tmp_path):
    rig = ring(5, distance=100.0, image_size=(32, 40), footprint=0.5, pitch_degrees=8.0)
    rig = replace(rig, cameras=(RayTable.of(rig[0]), *rig.cameras[1:]))
    simulate_images(rig, create("blobs", 1, GRID.extent, GRID.center), GRID).save(
        tmp_path / "scan"
    )
    return tmp_path / "scan"


@pytest.mark.parametrize("hold_out", ["cam00", "cam01"])
def test_reconstruct_with_a_table_held_out_and_not(
    run_tool, tmp_path, scan, nothing_sought, hold_out
):
    assert isinstance(load_rig(scan / "rig.yaml")["cam00"], RayTable)
    # the images are made of the very voxels
    options = ("--method", "cgls", "--basis", "voxel", "--json", "--no-pictures")
    options += (*nothing_sought, "--hold-out", hold_out, "-o", tmp_path / "out")
    done = run_tool("reconstruct", scan, *options)
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["quality"]["cosine_distance"] < 0.05
    assert result["held_out"][hold_out]["psnr"] > 25


def test_visualize(run_tool, tmp_path, scan):
    outs = [tmp_path / f"rig.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    grid = ("--grid", "10x14x10", "--spacing", "1")
    done = run_tool("visualize_rig", scan / "rig.yaml", *grid, *options)
    assert done.exit_code == 0, done.stderr
    assert all(out.stat().st_size > 1000 for out in outs)


def test_a_table_that_is_missing_or_broken_is_named(refused, tmp_path, scan):
    file = scan / "rig_rays_cam00.npz"
    np.savez(file, origins=np.zeros(3))
    line = refused("visualize_rig", scan / "rig.yaml", "-o", tmp_path / "rig.glb")
    assert "camera cam00: ray_table: rig_rays_cam00.npz: directions: missing" in line
    file.unlink()
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert "rig_rays_cam00.npz: no such file, which camera cam00 has for ray_table" in line
