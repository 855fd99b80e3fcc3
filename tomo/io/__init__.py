"""Volumes in and out; every file is written whole or not at all."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "volume_film": ["VolumeFilm"],
        "volumes": ["read_volume", "write_volume"],
        "xarray_volumes": ["data_array", "volume_of_data_array"],
    },
)
