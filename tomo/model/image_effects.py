"""The effects of cameras on the brightness and sharpness of their images."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import laplace

from tomo.measurement import NoiseModel
from tomo.model.effect import OfOneParameter, Prediction, image_frame
from tomo.model.observation import Images, Observation


@dataclass(frozen=True)
class Gain(OfOneParameter):
    """``b = exp(p) (A x)``: the logarithm of each view's exposure, aperture and sensitivity.

    ``sigma`` is its prior standard deviation: those of one kind differ by some per cent.
    """

    sigma: float = 0.05
    name = "gain"
    parameters = ("gain",)
    positive = False

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ``A x``, ``(1, pixels)``."""
        return at.pixels[None]

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images over their gains."""
        gains = np.exp(values[:, 0])
        noise = tuple(
            NoiseModel(one.read / g, one.gain / g)
            for one, g in zip(observation.noise, gains, strict=True)
        )
        images = (image / g for image, g in zip(observation.images, gains, strict=True))
        return replace(observation, images=_as_recorded(observation, images), noise=noise)


@dataclass(frozen=True)
class Background(OfOneParameter):
    """``b = A x + p``: a level beside the light of the volume, in the unit of the images.

    ``sigma`` is its prior standard deviation, a fraction of the brightest light: levels drift by
    less.
    """

    sigma: float = 0.01
    name = "background"
    parameters = ("level",)
    units = ("image",)

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return super().deviation(observation) * observation.brightest

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ones, ``(1, pixels)``."""
        return np.ones((1, len(at.pixels)))

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images less their levels."""
        both = zip(observation.images, values[:, 0], strict=True)
        less = (image - level for image, level in both)
        return replace(observation, images=_as_recorded(observation, less))


@dataclass(frozen=True)
class FallOff(OfOneParameter):
    """``b = (1 - p r²) (A x)``: vignetting, with ``r`` one in the corners of an image.

    ``sigma`` is the prior standard deviation of the loss there: that of usual lenses.
    """

    sigma: float = 0.2
    name = "fall-off"
    parameters = ("corners",)
    shared = True

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ``-r² (A x)``, ``(1, pixels)``."""
        parts = [
            -at.of_view(view, image * squared_radius(camera.image_size))
            for view, (camera, image) in enumerate(zip(at.observation.rig, at.images, strict=True))
        ]
        return np.concatenate(parts)[None]

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images over their fall-off."""
        each = zip(observation.rig, observation.images, values[:, 0], strict=True)
        images = (
            image / (1 - loss * squared_radius(camera.image_size)) for camera, image, loss in each
        )
        return replace(observation, images=_as_recorded(observation, images))


@dataclass(frozen=True)
class Blur(OfOneParameter):
    """``b = A x + p / 2 lap(A x)``: a blur of variance ``p``, in squared pixels, to first order.

    A lens out of focus, or a flame that moved while it was exposed. It is not taken out of images,
    where noise would grow, but put into the equations. ``sigma`` is the prior standard deviation:
    that of a blur by as many pixels as its root.
    """

    sigma: float = 2.0
    name = "blur"
    parameters = ("variance",)
    units = ("px²",)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return half the Laplacian of the prediction, ``(1, pixels)``."""
        parts = [at.of_view(view, laplace(image)) for view, image in enumerate(at.images)]
        return np.concatenate(parts)[None] / 2

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation whose equations have the blur."""
        before = observation.blur or (0.0,) * len(values)
        blur = tuple(a + float(b) for a, b in zip(before, values[:, 0], strict=True))
        return replace(observation, blur=blur)


def squared_radius(size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the squared distance of pixels from the image's middle, one in its corners: (h, w).

    ``size`` is (width, height).
    """
    x, y, radius = image_frame(size)
    width, height = size
    return (x**2 + y**2) * radius**2 / ((width / 2) ** 2 + (height / 2) ** 2)


def _as_recorded(observation: Observation, images: Iterable[NDArray]) -> Images:
    """Return images in the type that each was recorded in."""
    both = zip(images, observation.images, strict=True)
    return tuple(image.astype(recorded.dtype) for image, recorded in both)
