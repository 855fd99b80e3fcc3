"""Bits that a camera used of 16: said where numbers prove it, by a line that works."""

import re

import numpy as np
import pytest

import rigs
from rigs.recordings import write_image
from tomo import Scan, VoxelGrid
from tomo.measurement.stored_bits import stored_bits
from tomo.pipeline.load import load
from tomo.scan import Corrections

GRID = VoxelGrid((8, 8, 8), 1.0)
RIG = rigs.ring(3, distance=200.0, image_size=(40, 30), footprint=0.5)


def recorded(bits, exposure=1.0, seed=0):
    """Return a flame with photon noise, as integers of some bits that end where they end."""
    rows, columns = np.mgrid[-15:15, -20:20]
    flame = exposure * np.exp(-(rows**2 / 30 + columns**2 / 80))
    full = 2**bits - 1
    noisy = np.random.default_rng(seed).poisson(flame * 5000) / 5000 * full
    return np.clip(np.round(noisy), 0, full).astype(np.uint16)


def bits_lines(images, corrections=None):
    scan = Scan.from_arrays(
        RIG, dict(zip(RIG.names, images, strict=True)), GRID, corrections=corrections
    )
    return [line for line in load(scan, None).record.warnings if line.startswith("bits: ")]


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_saturated_pixels_show_where_a_camera_ends(bits):
    found = stored_bits(recorded(bits, 1.4))
    assert (found.bits, found.shift, found.largest) == (bits, 0, 2**bits - 1)
    assert found.pixels > 10


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("exposure", [0.3, 1.4])
def test_multiples_of_a_power_of_two_are_fewer_bits_shifted_up(bits, exposure):
    found = stored_bits(recorded(bits, exposure) << (16 - bits))
    assert (found.bits, found.shift) == (bits, 16 - bits)


def test_nothing_is_said_without_evidence():
    """Images of 16 bits, 12 bits that did not saturate, few levels, 8 bits times 257."""
    images = [
        recorded(16, exposure, seed) for seed, exposure in enumerate((0.005, 0.06, 0.3, 1.4))
    ]
    images += [recorded(12, 0.07), recorded(12, 0.8), recorded(8) * np.uint16(257)]
    images += [np.zeros((5, 5)), np.full((5, 5), 4096), 4096 * (np.arange(64).reshape(8, 8) % 4)]
    single = recorded(16, 0.04)
    single[np.unravel_index(single.argmax(), single.shape)] = 4095  # one pixel is chance
    for image in (*images, single):
        assert stored_bits(image).bits is None


def test_no_alarm_in_many_images_of_sixteen_bits():
    exposures = np.random.default_rng(1).uniform(0.01, 1.5, 300)
    assert all(stored_bits(recorded(16, e, n)).bits is None for n, e in enumerate(exposures))


def test_the_line_in_scan_yaml_makes_saturated_pixels_known():
    images = [recorded(12, exposure) for exposure in (0.5, 1.4, 1.4)]
    (line,) = bits_lines(images)
    assert "camera cam01 (and of 1 more) end at 4095, which" in line
    assert line.endswith("scan.with_corrections(bit_depth=12)")
    assert bits_lines(images, Corrections(bit_depth=12)) == []
    assert bits_lines(images, Corrections(bit_depth=16)) == []  # who knows better is believed


def test_only_cameras_that_fit_get_the_bits():
    """A camera of 16 bits beside one of 12 would be refused with 12."""
    (line,) = bits_lines([recorded(12, 1.4), recorded(16, 0.9), recorded(16, 0.9)])
    assert line.endswith("scan.with_corrections(bit_depth={'cam00': 12})")


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_numbers_shifted_up_get_a_level_of_saturation_that_works(bits, tmp_path):
    images = [recorded(bits, exposure) << (16 - bits) for exposure in (0.5, 1.4, 0.9)]
    (line,) = bits_lines(images)
    level = re.search(r"scan\.with_corrections\(saturation=([\d.]+)\)$", line)
    corrections = Corrections(saturation=float(level[1]))
    assert bits_lines(images, corrections) == []
    for image in images:
        write_image(tmp_path / "image.tif", image)
        _, usable, *_ = corrections.corrected(tmp_path / "image.tif", "cam00", (40, 30))
        top = image == (2**bits - 1) << (16 - bits)
        assert not usable[top].any()
        assert np.count_nonzero(~usable & ~top) <= 0.01 * image.size


def test_other_numbers_are_not_looked_at():
    top = recorded(12, 1.4)
    assert bits_lines([top.astype(np.float32)] * 3) == []
    assert bits_lines([(top // 16).astype(np.uint8)] * 3) == []
