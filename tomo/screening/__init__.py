"""Views against each other: which camera stands out and why, light from outside the grid."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "exchanged": ["Exchanged", "find_exchanged"],
        "left_out_prediction": ["PredictedViews"],
        "outside_light": ["light_outside"],
        "screening": ["Screening", "screen_images"],
        "turned_over": ["TurnedOver", "find_turned_over"],
        "single_camera": ["CameraFinding", "cameras_that_stand_out"],
    },
)
