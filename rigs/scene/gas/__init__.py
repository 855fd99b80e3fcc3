"""Gas that bends and absorbs: refractive index and extinction in boxes of voxels.

`IndexVolume` holds a refractive index at the centres of voxels, and `IndexField.cross` follows
rays through any field of it: curved paths become straight pieces. `ExtinctionVolume` holds how
strongly each voxel absorbs. `read_gas` reads both from files.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "extinction_volume": ["ExtinctionVolume"],
        "gas": ["Gas", "read_gas", "read_voxels", "write_voxels"],
        "index_field": ["IndexField", "Crossing"],
        "index_volume": ["IndexVolume"],
    },
)
