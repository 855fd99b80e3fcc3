"""WERNet: weights of voxels along rays, learned together with the voxels.

The network of Pan, Li and Xu (arXiv 2010.00893) replaces segment lengths by weights that an
encoder computes for each ray in each voxel. `WERNet` is the whole image formation as one torch
module, for training loops of one's own. Two methods train it:

- `wernet` (method ``wernet``): segment lengths corrected by an encoder, kept where left-out pixels
  ask for it;
- `wernet_paper` (method ``wernet-paper``): the published network, its weights the encoder's alone.

`project` and `ImageModel` are differentiable projections by the exact operator, for networks and
priors of one's own. PyTorch is loaded on first use of a name below.
"""

import lazy_loader

from tomo._compute import set_passive_waiting

set_passive_waiting()

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "encoder": ["Encoder"],
        "features": ["INPUTS", "OPTICS", "RayFeatures"],
        "files": ["load_encoder", "save_encoder"],
        "image_model": ["ImageModel"],
        "model": ["WERNet"],
        "paper": ["wernet_paper", "wernet_paper_frames"],
        "projection": ["project"],
        "rays": ["RayBatch", "Rays"],
        "settings": [
            "VARIANTS",
            "PaperSettings",
            "WernetSettings",
            "load_settings",
            "settings_names",
        ],
        "training": ["TrainingDivergedError", "usable_device"],
        "weights": ["RayWeights"],
        "wernet": ["wernet"],
    },
)
