"""Where the voxels are, which of them are unknowns, and in what order they are stored."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "active_voxels": ["ActiveVoxels"],
        "film_mean": ["mean_and_rms"],
        "volume": ["Volume"],
        "voxel_grid": ["VoxelGrid", "grid_of_rig"],
    },
)
