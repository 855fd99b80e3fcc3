"""The published network: Pan, Li, Xu, arXiv 2010.00893."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "encoder": ["VARIANTS", "WeightEncoder"],
        "model": ["WERNet"],
        "product": ["packed_sum", "weighted_sum"],
        "samples": ["PackedBatch", "RaySamples", "SampleBatch", "epoch_batches"],
        "wernet_paper": ["TrainingDivergedError", "wernet_paper"],
    },
)
