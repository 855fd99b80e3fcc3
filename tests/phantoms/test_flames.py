"""That the jet looks like a jet and the turbulent flame like turbulence, in numbers."""

import numpy as np
import pytest

import phantoms
from phantoms import JetFlame, TurbulentFlame
from tomo.grid import VoxelGrid

ANGLES = np.linspace(0, 2 * np.pi, 360, endpoint=False)


def azimuthal_variation(field):
    """Return the RMS over angles about each ring's mean, over the RMS of the rings' means."""
    radii, heights = np.linspace(0.25, 6, 24), np.linspace(-25, 25, 41)
    r, y, angle = np.meshgrid(radii, heights, ANGLES, indexing="ij")
    values = field(np.stack([r * np.cos(angle), y, r * np.sin(angle)], axis=-1))
    means = values.mean(axis=-1)
    weight = radii[:, None]  # area of a ring
    return np.sqrt((weight * values.var(axis=-1)).sum() / (weight * means**2).sum())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_jet_is_nearly_but_not_quite_symmetric(seed):
    assert 0.01 < azimuthal_variation(JetFlame(seed)) < 0.2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_turbulent_flame_is_asymmetric(seed):
    assert azimuthal_variation(TurbulentFlame(seed)) > 0.5


def ring_mean(field, radius, y):
    points = [radius * np.cos(ANGLES), np.full_like(ANGLES, y), radius * np.sin(ANGLES)]
    return field(np.stack(points, axis=-1)).mean()


def test_jet_is_hollow_then_closes_then_widens():
    field, radii = JetFlame(), np.linspace(0, 6.5, 131)

    def profile(y):
        return np.array([ring_mean(field, radius, y) for radius in radii])

    low, tip, high = profile(-20), profile(10), profile(26)
    assert low[0] < 0.1 * low.max()  # a sheet around dark gas
    assert tip[0] > 0.8 * tip.max()  # closed
    assert high[0] > 0.8 * high.max()
    half_radius = [radii[p > p.max() / 2].max() for p in (tip, high)]
    assert half_radius[1] > 1.3 * half_radius[0]  # the plume widens
    assert high.max() < 0.6 * tip.max()  # and dims


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_turbulent_front_is_two_to_three_voxels_thick(seed):
    """Along the gradient's direction the emission's full width at half maximum is 1 to 1.8 mm."""
    field = TurbulentFlame(seed)
    s = np.linspace(0, 7, 1401)
    widths = []
    for y in (-22.0, -18.0, -14.0):  # near the base, where fronts are single and nearly radial
        for angle in ANGLES[::20]:
            points = np.stack([s * np.cos(angle), np.full_like(s, y), s * np.sin(angle)], axis=-1)
            values = field(points)
            widths.append((values > values.max() / 2).sum() * s[1])
    assert 1.0 < np.median(widths) < 1.8


def test_turbulent_flame_does_not_alias_on_half_millimetre_voxels():
    """Halving the voxels changes little: linear interpolation is nearly exact."""
    field = TurbulentFlame()
    points = (np.random.default_rng(0).random((4000, 3)) - 0.5) * [12, 60, 12]
    step, exact = 0.25, field(points)
    around = sum(field(points + step * d) for d in np.vstack([np.eye(3), -np.eye(3)])) / 6
    error = np.sqrt(((around - exact) ** 2).mean() / (exact**2).mean())
    assert error < 0.1


def vertical_spectrum(field):
    """Return wavelengths and the mean power spectrum of vertical lines through the flame."""
    y = np.arange(-24, 24, 0.25)
    x, z = np.meshgrid(np.linspace(-4, 4, 9), np.linspace(-4, 4, 9), indexing="ij")
    points = np.stack(np.broadcast_arrays(x[..., None], y, z[..., None]), axis=-1)
    lines = field(points)
    lines = (lines - lines.mean(axis=-1, keepdims=True)) * np.hanning(len(y))
    power = (np.abs(np.fft.rfft(lines, axis=-1)) ** 2).mean(axis=(0, 1))
    return 1 / np.fft.rfftfreq(len(y), 0.25)[1:], power[1:] / power[1:].sum()


def test_turbulent_flame_has_a_broad_spectrum_and_the_jet_has_not():
    wavelength, turbulent = vertical_spectrum(TurbulentFlame())
    _, jet = vertical_spectrum(JetFlame())
    bands = [(24, 60), (12, 24), (6, 12), (3, 6)]
    energies = [turbulent[(wavelength >= a) & (wavelength < b)].sum() for a, b in bands]
    assert min(energies) > 0.05  # every octave holds a part
    assert turbulent[wavelength < 1.2].sum() < 0.01  # and there is next to nothing below
    assert jet[wavelength < 6].sum() < 0.1 * turbulent[wavelength < 6].sum()


def test_turbulent_flame_has_pockets():
    """Islands of light that are not joined to the main front: seen over a few seeds."""
    from scipy.ndimage import label

    grid = VoxelGrid((30, 140, 30), 0.5)
    islands = 0
    for seed in range(4):
        volume = phantoms.sample(TurbulentFlame(seed), grid)
        labels, _ = label(volume > 0.1)
        sizes = np.sort(np.bincount(labels.ravel())[1:])
        assert sizes[-1] > 0.5 * sizes.sum()  # one flame
        islands += (sizes[:-1] >= 8).sum()
    assert islands >= 2
