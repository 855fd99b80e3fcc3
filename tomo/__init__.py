"""Camera-based 3-D emission tomography: trace, project, reconstruct.

Names are loaded on first use, so that ``import tomo`` costs nothing that is not needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "io",
        "metrics",
        "noise",
        "reconstruct",
        "simulate",
        "solve",
        "trace",
        "view",
        "wernet",
    ],
    submod_attrs={
        "corrections": ["Corrections"],
        "grid": ["VoxelGrid"],
        "live_voxels": ["LiveVoxels"],
        "linear_system": ["LinearSystem"],
        "projector": ["Projector", "dot_test"],
        "rays": ["Rays"],
        "reconstruction": ["Iteration", "Reconstruction"],
        "scan": ["Frame", "Scan"],
        "scan_file": ["save_scan"],
        "segments": ["Segments"],
        "smooth_basis": ["SmoothBasis"],
    },
)
