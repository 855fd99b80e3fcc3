"""How smooth a volume, and how many iterations: chosen by cross-validation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "choose": [
            "Choice",
            "choose_by_left_out_pixels",
            "solve_as_chosen",
        ],
        "folds": ["Fold"],
        "smooth_solve": ["solve_several_smoothly"],
    },
)
