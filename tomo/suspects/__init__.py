"""What the images themselves give away as wrong: wild pixels, and views of something else."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "below_zero": ["below_zero"],
        "background": ["background"],
        "beside_grid": ["light_beside"],
        "predictions": ["Predictions"],
        "suspects": ["Suspects", "find_suspects"],
        "views": ["ViewVerdict", "judge_views"],
        "wild": ["wild_pixels"],
    },
)
