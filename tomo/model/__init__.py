"""How pixels come about: the operator, and the effects of cameras and gas on what it predicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "absorber": ["Absorber"],
        "absorbing": ["Absorbing"],
        "background": ["Background"],
        "blur": ["Blur"],
        "corrections": ["Corrections"],
        "effect": ["Effect", "Prediction"],
        "fall_off": ["FallOff", "squared_radius"],
        "gain": ["Gain"],
        "gauge": ["without_gauge"],
        "observation": ["Observation"],
        "outside": ["Surroundings"],
        "pose": ["Pose"],
    },
)
