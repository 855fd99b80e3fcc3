"""One image by itself: noise, pixel weights, bad pixels, background."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "pixel_check": ["cut_off_level", "background", "below_zero", "check_sizes"],
        "bad_pixels": ["usable_pixels", "DeadLines", "find_dead_lines"],
        "noise_model": ["NoiseModel", "estimate_noise"],
        "outlier_pixels": ["find_outlier_pixels"],
        "pixel_weights": ["PixelWeights", "weigh_pixels"],
        "stored_bits": ["StoredBits"],
    },
)
