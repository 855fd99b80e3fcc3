"""Camera-based 3-D emission tomography: the public names of `rigs`, `phantoms` and `tomo`.

Cameras are in `rigs`, known emissions in `phantoms`, the way from images to a volume in `tomo`;
``help`` of each says more. Here all of their names stand beside each other. ``Volume`` is that of
`tomo`; the box of a rig is ``rigs.Volume``.

Examples
--------
>>> import flametomo
>>> grid = flametomo.VoxelGrid(shape=(8, 16, 8), spacing=1.0)
>>> rig = flametomo.ring(6, distance=500, image_size=(24, 36), footprint=0.6, pitch_degrees=10)
>>> flame = flametomo.create("jet", extent=grid.extent)
>>> scan = flametomo.simulate(rig, flame, grid)
>>> flametomo.reconstruct(scan, method="mlem", iterations=30).volume.shape
(8, 16, 8)

Names are loaded on first use, so that ``import flametomo`` is fast.
"""

from typing import Any

import phantoms
import rigs
import tomo
from rigs.lazy_names import no_such_name

_HOMES = {name: home for home in (rigs, phantoms, tomo) for name in home.__all__}

__all__ = sorted({*_HOMES, "phantoms", "rigs", "tomo"})


def __getattr__(name: str) -> Any:
    """Return a name of the packages; a wrong one is answered with the right one."""
    if name not in _HOMES:
        raise no_such_name("flametomo", name, __all__)
    return getattr(_HOMES[name], name)


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
