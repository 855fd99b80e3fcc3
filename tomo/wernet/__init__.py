"""WERNet: weights of voxels along rays, learned together with the voxels.

The network of Pan, Li and Xu (arXiv 2010.00893) replaces segment lengths by weights that an
encoder computes for each ray in each voxel. Two forms are here:

- `tomo.wernet.default`: segment lengths corrected by an encoder (method ``wernet``);
- `tomo.wernet.paper`: the published network (method ``wernet-paper``).

`PaperSettings` and `WernetSettings` (`settings`) hold what both leave to choose.

They share the packing of rays (`packing`), the convolution (`convolution`), micro-batches
(`micro_batches`), the device (`device`), ray directions (`ray_directions`) and files of encoders
(`encoder_file`). PyTorch is loaded on first use of a name below.
"""

import lazy_loader

from tomo._compute.wait_policy import set_passive_waiting

set_passive_waiting()

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "convolution": ["packed_convolution"],
        "default.encoder": ["CorrectionEncoder"],
        "default.learned_weights": ["LearnedWeights", "Profile"],
        "default.ray_features": ["RayFeatures"],
        "default.ray_weights": ["RayWeights"],
        "default.wernet": ["wernet"],
        "device": ["usable_device"],
        "encoder_file": ["load_encoder", "save_encoder"],
        "packing": ["Packing"],
        "paper.encoder": ["WeightEncoder"],
        "paper.model": ["WERNet"],
        "paper.product": ["packed_sum", "weighted_sum"],
        "paper.samples": ["PackedBatch", "RaySamples", "SampleBatch", "epoch_batches"],
        "paper.wernet_paper": ["TrainingDivergedError", "wernet_paper"],
        "settings": [
            "VARIANTS",
            "PaperSettings",
            "WernetSettings",
            "load_settings",
            "settings_names",
        ],
    },
)
