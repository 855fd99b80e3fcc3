"""Where rays meet voxels: three tracers that give the same segments.

``reference`` is the slow, readable float64 oracle, ``raycast`` asks Open3D's RaycastingScene, and
``march`` is the compiled walk that everything uses by default.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "segments": ["Segments", "merging"],
        "tracers": ["MOST_VOXELS", "TRACERS", "trace", "tracing"],
    },
)
