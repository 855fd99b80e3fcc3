"""WERNet: the voxels' weights along a ray are learnt together with the voxels.

Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a Semi-Case-Wise
and Learning-Based Way", arXiv 2010.00893. PyTorch is loaded on first use of a name below.
"""

import lazy_loader

from tomo._compute.wait_policy import wait_asleep

wait_asleep()

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "convolution": ["packed_convolution"],
        "default.correction": ["CorrectionEncoder", "ViewTokens"],
        "default.ray_features": ["RayFeatures"],
        "default.ray_weights": ["RayWeights"],
        "default.summary": ["LearnedWeights", "Profile"],
        "default.wernet": ["wernet"],
        "device": ["usable_device"],
        "encoder_file": ["load_encoder", "save_encoder"],
        "packing": ["Packing"],
        "paper.encoder": ["VARIANTS", "WeightEncoder"],
        "paper.model": ["WERNet"],
        "paper.product": ["packed_sum", "weighted_sum"],
        "paper.samples": ["PackedBatch", "RaySamples", "SampleBatch", "epoch_batches"],
        "paper.wernet_paper": ["TrainingDivergedError", "wernet_paper"],
    },
)
