"""The light of a volume at a view's pixels is that of its images, however coarse pixels are."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from rigs.scene import Glass, Scene, Window
from tomo.grid import VoxelGrid
from tomo.operators import Absorption, LinearSystem
from tomo.selfcal import total_light
from tomo.selfcal.total_light import ViewLight, view_sums

GRID = VoxelGrid((12, 20, 14), (1.0, 0.8, 1.2), (1.0, -2.0, 0.5))
FIELD = phantoms.GaussianBlobs(
    GRID.center + np.array([[-2.0, -3, 0.5], [1.5, 2, -1.4]]), [1.0, 1.2], [1.0, 0.8]
)
VOLUME = phantoms.sample(FIELD, GRID)


def rig_of(size=(12, 20), **how):
    around = {"distance": 60.0, "footprint": 2.4, "center": GRID.center, "pitch_degrees": 20.0}
    return rigs.ring(4, image_size=size, **around | how)


def seen_with_many_rays(system, absorption=None):
    """Return the sums of the views' pixels as 24 x 24 rays a pixel see them."""
    masks = [image > 0 for image in system.images(np.ones(system.projector.shape[0], np.float32))]
    fine = LinearSystem.from_rig(system.rig, GRID, masks=masks, supersample=24, skip=False)
    if absorption is not None:
        fine = fine.with_absorption(absorption, VOLUME, supersample=24)
    return view_sums(fine.projector, fine.projector @ VOLUME.ravel())


def totals(light, system):
    predicted = np.asarray(system.projector @ VOLUME.ravel(), np.float64)
    return light.totals(system.projector, VOLUME.ravel(), predicted), predicted


def with_lens(camera):
    return replace(camera, distortion=rigs.Distortion("brown", (-0.6, 0.2, 0.004, -0.003)))


@pytest.mark.parametrize("lens", [False, True])
def test_coarse_pixels_record_the_light_that_many_rays_find(lens):
    rig = rig_of()
    if lens:
        rig = replace(rig, cameras=tuple(map(with_lens, rig)))
    system = LinearSystem.from_rig(rig, GRID)
    found, predicted = totals(ViewLight.of(system), system)
    true = seen_with_many_rays(system)
    np.testing.assert_allclose(found, true, rtol=0.003)
    assert np.abs(view_sums(system.projector, predicted) / true - 1).max() > 0.01


def test_pixels_that_take_no_part_record_nothing():
    rig = rig_of((40, 64), footprint=0.75)
    masks = [np.ones(camera.image_size[::-1], bool) for camera in rig]
    masks[1][:, :20] = False
    system = LinearSystem.from_rig(rig, GRID, masks=masks)
    found, _ = totals(ViewLight.of(system), system)
    true = seen_with_many_rays(system)
    assert true[1] < 0.8 * true[0]
    np.testing.assert_allclose(found, true, rtol=0.03)


def test_many_voxels_are_summed_over_cells(monkeypatch):
    system = LinearSystem.from_rig(rig_of(), GRID)
    exact, _ = totals(ViewLight.of(system), system)
    monkeypatch.setattr(total_light, "MOST_CELLS", 600)
    light = ViewLight.of(system)
    assert light.edge > 1
    assert light.weight.shape[1] <= 1000
    np.testing.assert_allclose(totals(light, system)[0], exact, rtol=0.01)


def test_light_that_gas_absorbs_does_not_arrive():
    absorption = Absorption(medium=0.05)
    clear = LinearSystem.from_rig(rig_of((24, 40), footprint=1.2), GRID)
    through = clear.with_absorption(absorption)
    found, _ = totals(ViewLight.of(through, clear), through)
    true = seen_with_many_rays(through, absorption)
    assert (true < 0.85 * seen_with_many_rays(clear)).all()
    np.testing.assert_allclose(found, true, rtol=0.02)


def test_a_camera_behind_glass_has_the_sums_of_its_rays():
    rig = rig_of()
    towards = (rig[0].position - GRID.center) / 60
    pane = Window("pane", GRID.center + 30 * towards, towards, 4, Glass("quartz"), size=40)
    plain = LinearSystem.from_rig(rig, GRID)
    system = LinearSystem.from_rig(rig.through(Scene((pane,), fresnel=True)), GRID)
    found, predicted = totals(ViewLight.of(system), system)
    assert found[0] == pytest.approx(view_sums(system.projector, predicted)[0], rel=1e-6)
    sums = view_sums(plain.projector, plain.projector @ VOLUME.ravel())
    assert found[0] == pytest.approx(0.93 * sums[0], rel=0.04)  # what two faces of quartz pass
