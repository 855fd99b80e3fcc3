"""WERNet: the voxels' weights along a ray are learnt together with the voxels.

Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a Semi-Case-Wise
and Learning-Based Way", arXiv 2010.00893. PyTorch is loaded on first use of a name below.
"""

import lazy_loader

from tomo._waiting import wait_asleep

wait_asleep()

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "convolution": ["packed_convolution"],
        "device": ["usable_device"],
        "encoder": ["VARIANTS", "WeightEncoder"],
        "encoder_file": ["load_encoder", "save_encoder", "shipped_encoders"],
        "correction": ["CorrectionEncoder", "ViewTokens"],
        "default": ["wernet"],
        "learned": ["LearnedWeights", "Profile"],
        "model": ["WERNet"],
        "packing": ["Packing"],
        "ray_features": ["RayFeatures"],
        "ray_weights": ["RayWeights"],
        "product": ["packed_sum", "weighted_sum"],
        "samples": ["PackedBatch", "RaySamples", "SampleBatch", "epoch_batches"],
        "training": ["TrainingDivergedError", "wernet_paper"],
    },
)
