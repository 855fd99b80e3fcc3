"""Voxels and effects found with the products of an operator on a device."""

from dataclasses import replace

import numpy as np

from tomo.inference.solve import equations_of, first_fits, next_fits
from tomo.model.gain import Gain
from tomo.operators.gpu import on_device
from tomo.operators.gpu.device_operator import DeviceOperator


def test_fits_and_steps_of_effects_are_those_of_the_cpu(observed, host):
    observation, _ = observed
    (system,) = equations_of([observation], None)
    moved, reason = on_device(system.projector, host)
    assert isinstance(moved, DeviceOperator), reason
    found = []
    for one in (system, replace(system, projector=moved)):
        fits = first_fits([observation], systems=[one])
        fits, step = next_fits(fits, [Gain()])
        (fit,) = fits
        found.append((fit.unknowns, fit.measured - fit.residual, 1 + step["gain"]))
    for expected, values in zip(*found, strict=True):
        # the rounding of single precision grows in weights that depend on residuals
        assert np.abs(values - expected).max() <= 1e-3 * np.abs(expected).max()
