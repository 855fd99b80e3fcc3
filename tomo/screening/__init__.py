"""Views against each other: which camera the others contradict, light from outside the grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "left_out_prediction": ["Predictions"],
        "outside_light": ["light_outside"],
        "screening": ["Screening", "screen_images"],
        "view_consistency": ["ViewConsistency", "check_consistency"],
    },
)
