"""Absolute light: units of radiance and emission, and temperatures from two colours."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "two_colour": ["temperature_from_ratio", "temperature_of_volumes", "planck_radiance"],
        "units": ["LightUnit", "images_to_volume", "photon_energy", "unit_of_total"],
    },
)
