"""Camera-based 3-D emission tomography: trace, project, reconstruct.

Names are loaded on first use, so that ``import tomo`` costs nothing that is not needed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["io", "metrics", "noise", "solve", "support", "trace", "view", "wernet"],
    submod_attrs={
        "grid": ["VoxelGrid"],
        "projector": ["Projector", "dot_test"],
        "rays": ["Rays"],
        "reconstruct": ["reconstruct"],
        "reconstruction": ["Reconstruction"],
        "scan": ["Scan"],
        "segments": ["Segments"],
        "simulate": ["simulate"],
    },
)
