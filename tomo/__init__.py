"""Camera-based 3-D emission tomography: trace, project, reconstruct.

Names are loaded on first use, so that ``import tomo`` costs nothing that is not needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=[
        "draw",
        "io",
        "metrics",
        "radiometry",
        "report",
        "simulation",
        "solvers",
        "wernet",
    ],
    submod_attrs={
        "grid": ["ActiveVoxels", "VoxelGrid"],
        "operators": ["LinearSystem", "Projector", "GaussianBasis", "dot_test"],
        "pipeline": ["Options", "Reconstruction", "reconstruct"],
        "rays": ["Rays"],
        "scan": ["Corrections", "Frame", "Scan", "load_scan", "save_scan", "scan_of_images"],
        "simulation": ["simulate"],
        "solvers": ["Iteration", "Solution"],
        "trace": ["Segments", "trace"],
    },
)
