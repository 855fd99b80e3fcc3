"""Films in, films out: many frames of one rig, by one plan, into a store that can go on."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "cluster": ["on_cluster"],
        "frames": ["choose_frames"],
        "plan": ["Plan"],
        "settle": ["make_plan"],
        "run": ["reconstruct_series"],
        "store": ["SeriesStore"],
    },
)
