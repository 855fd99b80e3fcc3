"""How pixels come about: the operator, and the effects of cameras and gas on what it predicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "absorber": ["Absorber", "Absorbing"],
        "corrections": ["Corrections"],
        "effect": ["Effect", "Prediction"],
        "image_effects": ["Gain", "Background", "FallOff", "squared_radius", "Blur"],
        "gauge": ["without_gauge"],
        "observation": ["Observation"],
        "pose": ["Pose"],
    },
)
