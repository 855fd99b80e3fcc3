"""A table of rays in place of the camera that it was sampled from: the same all the way."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phantoms import GaussianBlobs, create
from rigs import Distortion, RayTable, load_rig, ring
from tomo import VoxelGrid, load_scan
from tomo.draw.rig.rig_scene import rig_scene
from tomo.hull import carve
from tomo.inference.infer import infer
from tomo.inference.solve import first_fit
from tomo.measurement import estimate_noise
from tomo.metrics import cosine_distance
from tomo.model import Observation, Pose
from tomo.operators import LinearSystem
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 18, 12), 1.0, (1.0, -2.0, 0.5))
LENS = Distortion("brown", (-0.15, 0.05, 0.001, -0.002, 0.01))


def rig_of(lens=LENS, seed=0, views=5, size=(44, 56)):
    rig = ring(views, distance=60.0, image_size=size, footprint=0.45, center=GRID.center)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    moved = rig.transformed(turn, np.array(GRID.center) - turn @ GRID.center)
    return replace(moved, cameras=tuple(replace(c, distortion=lens) for c in moved))


def tables(rig):
    return replace(rig, cameras=tuple(RayTable.of(camera) for camera in rig))


@pytest.fixture(scope="module")
def rig():
    return rig_of()


@pytest.fixture(scope="module")
def made(rig):
    return simulate_images(rig, create("blobs", 1, GRID.extent, GRID.center), GRID, supersample=2)


@given(
    seed=st.integers(0, 999),
    lens=st.sampled_from([Distortion(), LENS, Distortion("fisheye", (0.02, 0, 0, 0))]),
)
@settings(max_examples=8)
def test_every_tracer_finds_the_same_segments(seed, lens):
    rig = rig_of(lens, seed, views=2, size=(11, 14))
    for tracer in ("march", "reference", "raycast"):
        one, other = (
            LinearSystem.from_rig(r, GRID, tracer=tracer, midpoints=True, form="stored")
            for r in (rig, tables(rig))
        )
        for kept, expected in zip(other.pixels, one.pixels, strict=True):
            np.testing.assert_array_equal(kept, expected)
        found, expected = other.projector.segments, one.projector.segments
        np.testing.assert_array_equal(found.ptr, expected.ptr)
        np.testing.assert_array_equal(found.voxel, expected.voxel)
        np.testing.assert_array_equal(found.length, expected.length)
        np.testing.assert_array_equal(found.midpoint, expected.midpoint)


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
@pytest.mark.parametrize("supersample", [1, 2])
def test_projections_agree(rig, form, supersample):
    systems = [
        LinearSystem.from_rig(r, GRID, form=form, skip=False, supersample=supersample)
        for r in (rig, tables(rig))
    ]
    x = np.random.default_rng(0).uniform(size=systems[0].projector.shape[1]).astype(np.float32)
    expected, found = (system.projector @ x for system in systems)
    # on the fly a camera's lens is single precision; between centres a table is interpolated
    tolerance = 1e-6 if supersample == 1 else 2e-3
    assert np.abs(found - expected).max() < tolerance * expected.max()
    back = [s.projector.T @ np.ones(s.projector.shape[0], np.float32) for s in systems]
    assert np.abs(back[1] - back[0]).max() < tolerance * back[0].max()


def test_simulation_agrees_and_comes_back_from_disk(rig, made, tmp_path):
    field = create("blobs", 1, GRID.extent, GRID.center)
    same = simulate_images(tables(rig), field, GRID, supersample=1)
    expected = simulate_images(rig, field, GRID, supersample=1)
    for name in rig.names:
        np.testing.assert_allclose(same.images[name], expected.images[name], rtol=1e-5, atol=1e-5)
    same.save(tmp_path / "scan")
    assert load_rig(tmp_path / "scan" / "rig.yaml") == tables(rig)
    assert load_scan(tmp_path / "scan").rig == tables(rig)


@pytest.mark.parametrize("method", ["cgls", "mlem"])
def test_reconstructions_agree(rig, made, tmp_path, as_given, method):
    made.save(tmp_path)
    scan = load_scan(tmp_path)
    options = as_given | {"method": method, "iterations": 8, "hold_out": [rig.names[1]]}
    expected = reconstruct(scan, options=Options(**options))
    found = reconstruct(replace(scan, rig=tables(rig)), options=Options(**options))
    volumes = [outcome.volume for outcome in (expected, found)]
    assert cosine_distance(volumes[1], volumes[0]) < 1e-6
    held = [outcome.report()["held_out"][rig.names[1]]["psnr"] for outcome in (expected, found)]
    assert held[1] == pytest.approx(held[0], abs=0.05)


def test_carving_agrees(rig, made):
    images = [made.images[name] for name in rig.names]
    one, other = (carve(tuple(r), images, None, GRID, margin=1.0) for r in (rig, tables(rig)))
    before, after = (c.active.expand(np.ones(c.active.size)) > 0 for c in (one, other))
    assert 0.05 < np.mean(before) < 0.9
    # a voxel's box of pixels is grown by how far its corners may be off: little else differs
    assert np.mean(after != before) < 0.01
    for found, expected in zip(other.pixels, one.pixels, strict=True):
        assert np.mean(found != expected) < 0.02


@pytest.mark.parametrize("seed", [1, 2])
def test_tables_that_are_off_are_moved_like_cameras(rig, seed):
    """But they have no roll and no zoom."""
    places = GRID.center + np.array([[1.5, -3, 0.5], [-2, 1, -1], [0.5, 4, 2]])
    field = GaussianBlobs(places, [2.0, 1.8, 1.6], [1.0, 0.8, 0.9])
    images = tuple(simulate_images(rig, field, GRID, supersample=2).images.values())
    masks = tuple(np.ones(image.shape, bool) for image in images)
    noise = tuple(map(estimate_noise, images, masks))
    shifts = np.random.default_rng(seed).normal(0, 1.5, (len(rig), 2))
    left = []
    for right in (rig, tables(rig)):
        wrong = (camera.shifted(*own) for camera, own in zip(right, shifts, strict=True))
        observation = Observation(replace(right, cameras=tuple(wrong)), images, masks, noise, GRID)
        before = first_fit(observation)
        state = infer([observation], (Pose(),), asked=("pose",), look_outside=False).state
        assert np.linalg.norm(state.fits[0].residual) < 0.4 * np.linalg.norm(before.residual)
        left.append(np.linalg.norm(state.fits[0].residual))
        seen = Pose().applied(observation, state.values["pose"])
        assert all(type(camera) is type(right[0]) for camera in seen.rig)
    assert np.abs(state.values["pose"][:, 2:4]).max() < 1e-3
    assert left[1] < 1.5 * left[0]


def test_pixels_that_see_nothing_take_no_part(rig):
    camera = RayTable.of(rig[0])
    directions = camera.directions.copy()
    directions[20:30, 15:25] = np.nan
    holed = replace(rig, cameras=(replace(camera, directions=directions), *rig.cameras[1:]))
    system = LinearSystem.from_rig(holed, GRID)
    blind = np.flatnonzero(np.isnan(directions[..., 0]))
    assert len(blind) == 100
    assert not np.isin(blind, system.pixels[0]).any()
    whole = LinearSystem.from_rig(rig, GRID)
    np.testing.assert_array_equal(system.pixels[1], whole.pixels[1])


def test_a_camera_in_a_mirror_reconstructs_as_the_one_behind_it(rig):
    """Every second camera looks into a plane mirror; its image is what it would be, mirrored."""
    field = create("blobs", 1, GRID.extent, GRID.center)
    mirrored = []
    for camera in rig:
        origins, directions = camera.rays()
        height, width = camera.image_size[::-1]
        normal, hits = camera.R[2], origins + 15 * directions
        # seen from behind the mirror: the rays leave it as they came, left and right exchanged
        flipped = np.flip(np.stack([hits, directions]).reshape(2, height, width, 3), axis=2)
        assert (directions @ normal > 0).all()
        mirrored.append(RayTable(camera.name, *flipped))
    other = replace(rig, cameras=tuple(mirrored))
    images = simulate_images(rig, field, GRID).images
    flipped = simulate_images(other, field, GRID).images
    for name in rig.names:
        np.testing.assert_allclose(flipped[name][:, ::-1], images[name], rtol=1e-5, atol=1e-5)
    systems = [LinearSystem.from_rig(r, GRID) for r in (rig, other)]
    assert systems[0].projector.n_segments == systems[1].projector.n_segments


def test_two_views_in_one_image_are_never_carved_away(rig, made):
    """Of a point with two images one place is no proof: such a camera judges nothing."""
    a, b = (RayTable.of(camera) for camera in rig.cameras[:2])
    directions = np.concatenate([a.directions, b.directions], axis=1)
    directions[:, 44] = np.nan
    origins = np.concatenate(
        [np.broadcast_to(one.position, one.directions.shape) for one in (a, b)], axis=1
    )
    split = RayTable("split", origins, directions)
    images = [made.images[name] for name in rig.names]
    both = np.concatenate(images[:2], axis=1)
    cameras = (split, *rig.cameras[2:])
    carving = carve(cameras, [both, *images[2:]], None, GRID, margin=1.0)
    assert carving.pixels[0].all()
    system = LinearSystem.from_rig(replace(rig, cameras=cameras), GRID)
    assert (system.pixels[0] % 88 < 44).any()
    assert (system.pixels[0] % 88 > 44).any()


def test_it_is_drawn(rig):
    scene = rig_scene(tables(rig), GRID)
    expected = rig_scene(rig, GRID)
    assert {mesh.group for mesh in scene.meshes} == {mesh.group for mesh in expected.meshes}
    for found, one in zip(scene.meshes, expected.meshes, strict=True):
        if found.group == "cameras":
            np.testing.assert_allclose(found.vertices, one.vertices, atol=1.5)
