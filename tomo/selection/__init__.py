"""Which method, how strong a prior, how many iterations: chosen by cross-validation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "choose": ["Choice", "choose_by_held_out_views"],
    },
)
