"""Absolute light: what one count of each camera's images is worth, by a known radiance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from tomo.radiometry.units import LightUnit, images_to_volume
from tomo.scan.corrections import Corrections, for_camera
from tomo.scan.known_light import counts_of_known_light

CONDITIONS = {"exposure": 1, "f_number": -2, "transmission": 1}
"""What a pixel's signal is proportional to, and to which power."""

Each = float | Mapping[str, float] | None


@dataclass(frozen=True)
class Calibration:
    """How cameras saw a known radiance; each value is one for all cameras, or one for each.

    Attributes
    ----------
    factor : float, or a mapping to float
        Radiance of one count: of a number as stored, after dark and flat.
    image : Path or array, or a mapping to these
        In place of ``factor``: a lamp or an integrating sphere.
    radiance : float, or a mapping to float
        That of the lamp or sphere, of the light that the filter passes.
    region : (x, y, width, height), or a mapping to these
        The part of the image that shows it; the whole image when None. In pixels as recorded.
    dark : float or Path, or a mapping to these
        The reading without light at this exposure; the scan's own when None.
    exposure, f_number, transmission
        See `Radiometry`, while the camera saw the known radiance.
    """

    factor: Each = None
    image: Path | NDArray | Mapping[str, Path | NDArray] | None = None
    radiance: Each = None
    region: Sequence[int] | Mapping[str, Sequence[int]] | None = None
    dark: float | Path | Mapping[str, float | Path] | None = None
    exposure: Each = None
    f_number: Each = None
    transmission: Each = None


@dataclass(frozen=True)
class Radiometry:
    """What makes radiances of counts; a camera that nothing is known of takes the others' mean.

    Attributes
    ----------
    unit : str
        Of ``factor`` and ``radiance``, see `tomo.radiometry.LightUnit`.
    calibration : Calibration
    volume_unit : str, optional
        Of the volume: W or photons/s per cubic metre and steradian when None.
    wavelength : float, optional
        In nm, to turn watts into photons or photons into watts.
    exposure : float, or a mapping to float
        Seconds that the scan's images were exposed.
    f_number : float, or a mapping to float
        Their lens's working f-number.
    transmission : float, or a mapping to float
        That of filters and windows in front of the camera, up to 1.

    Notes
    -----
    A pixel's signal is ``S = C L t T / N^2``: camera's constant, radiance, exposure, transmission,
    f-number. With a known radiance ``L0`` that gave ``S0`` the scan's radiance is
    ``L = S (L0 / S0) (t0 / t) (T0 / T) (N / N0)^2``.

    Examples
    --------
    >>> Radiometry("W/m^2/sr", Calibration(factor=3.1e-7)).value_unit
    'W/m^3/sr'
    """

    unit: str
    calibration: Calibration = field(default_factory=Calibration)
    volume_unit: str | None = None
    wavelength: float | None = None
    exposure: Each = None
    f_number: Each = None
    transmission: Each = None

    def __post_init__(self) -> None:
        """Check units and numbers that need no images."""
        images_to_volume(self._radiance, self._emission, "m", self.wavelength)
        for place, values in (("", self), ("calibration.", self.calibration)):
            for one in fields(values):
                if one.name in ("factor", "radiance", "wavelength", *CONDITIONS):
                    _check_positive(f"{place}{one.name}", getattr(values, one.name))
        if self.calibration.factor is None and self.calibration.image is None:
            raise ValueError("calibration: found neither factor nor image, expected one of them")

    @property
    def _radiance(self) -> LightUnit:
        return _unit("unit", self.unit, LightUnit.of_radiance)

    @property
    def _emission(self) -> LightUnit:
        if self.volume_unit is None:
            return self._radiance.emission
        return _unit("volume_unit", self.volume_unit, LightUnit.of_emission)

    @property
    def value_unit(self) -> str:
        """The unit of a volume's values."""
        return str(self._emission)

    def calibrated(self, cameras: Sequence[str]) -> tuple[str, ...]:
        """Return those of the cameras whose counts have a known radiance."""
        known = self.calibration
        return tuple(
            name
            for name in cameras
            if any(for_camera(one, name) is not None for one in (known.factor, known.image))
        )

    def per_count(
        self,
        sizes: Mapping[str, tuple[int, int]],
        corrections: Corrections,
        length_unit: str,
        source: Path | None = None,
    ) -> dict[str, float]:
        """Return what one count of each camera is worth, in volume's unit times unit of length.

        A projection of the volume is then an image. Cameras without a calibration take the
        geometric mean of the others, at their own exposure, f-number and transmission. ``sizes``
        are ``(width, height)`` of images as recorded; all ``corrections`` but the gain apply to
        images of a known radiance; errors name ``source``.

        Raises
        ------
        ValueError
            If no camera is calibrated, an image of a known radiance is dark, saturated, uneven or
            unreadable, its region is not inside it, or an exposure, f-number or transmission is
            known of the scan alone or of the calibration alone.
        """
        where = "" if source is None else f"{source}: "
        known = self.calibrated(tuple(sizes))
        if not known:
            raise ValueError(
                f"{where}radiometry.calibration: found none of the cameras {', '.join(sizes)}, "
                "expected factor or image of one at least"
            )
        try:
            scale = images_to_volume(self._radiance, self._emission, length_unit, self.wavelength)
            found = {
                name: scale * self._of_camera(name, sizes[name], corrections) for name in known
            }
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{where}radiometry.calibration.image: {error}") from error
        except ValueError as error:
            raise ValueError(f"{where}radiometry.{error}") from error
        return {name: found.get(name) or self._like_others(name, found) for name in sizes}

    def note(self, cameras: Sequence[str]) -> str | None:
        """Return the line on cameras without a calibration; None where all have one."""
        known = self.calibrated(cameras)
        rest = [name for name in cameras if name not in known]
        if not rest:
            return None
        calibrated = f"{len(known)} calibrated camera{'s' if len(known) > 1 else ''}"
        return (
            f"radiometry: found no calibration of camera {', '.join(rest)}: they are taken to "
            "respond like the mean of the others until gains are fitted (--fit-gain), and the "
            f"volume's scale is that of {calibrated}. Give radiometry.calibration a factor or an "
            "image of each"
        )

    def _of_camera(self, camera: str, size: tuple[int, int], corrections: Corrections) -> float:
        """Return the radiance of one count of the scan's images."""
        known, where = self.calibration, f"camera {camera}: "
        factor, image = (for_camera(one, camera) for one in (known.factor, known.image))
        if factor is not None and image is not None:
            raise ValueError(f"calibration: {where}found factor and image, expected one of them")
        if factor is None:
            radiance = for_camera(known.radiance, camera)
            if radiance is None:
                raise ValueError(
                    f"calibration.radiance: {where}missing, expected that of its image"
                )
            region, dark = (for_camera(one, camera) for one in (known.region, known.dark))
            factor = radiance / counts_of_known_light(
                image, camera, size, corrections, region, dark
            )
        for name, power in CONDITIONS.items():
            now, then = (for_camera(getattr(one, name), camera) for one in (self, known))
            if (now is None) != (then is None):
                lacking = name if now is None else f"calibration.{name}"
                raise ValueError(
                    f"{lacking}: {where}missing, expected one as the "
                    f"{'calibration' if now is None else 'scan'} has {name} "
                    f"{then if now is None else now:g}: their ratio counts"
                )
            if now is not None:
                factor *= (then / now) ** power
        return factor

    def _like_others(self, camera: str, found: Mapping[str, float]) -> float:
        """Return the others' mean, at the camera's exposure, f-number and transmission."""
        logs = []
        for other, factor in found.items():
            for name, power in CONDITIONS.items():
                own, its = (for_camera(getattr(self, name), one) for one in (camera, other))
                if own is not None and its is not None:
                    factor *= (its / own) ** power
            logs.append(math.log(factor))
        return math.exp(sum(logs) / len(logs))


def _unit(name: str, text: str, parse: Any) -> LightUnit:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _check_positive(name: str, value: Each) -> None:
    """Refuse numbers that no camera or lamp has."""
    most = 1.0 if name.endswith("transmission") else math.inf
    each = value if isinstance(value, Mapping) else {None: value}
    for camera, one in each.items():
        if one is not None and not (0 < one <= most and math.isfinite(one)):
            where = "" if camera is None else f"camera {camera}: "
            upper = " up to 1" if most == 1 else ""
            raise ValueError(f"{name}: {where}found {one:g}, expected a number above 0{upper}")
