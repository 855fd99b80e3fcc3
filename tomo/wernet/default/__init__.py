"""The default WERNet: segment lengths corrected by what the images ask for.

The classic model predicts a pixel by ``p_i = sum_j a_ij x_j`` with the segment lengths ``a``. Here
each length is corrected by a factor near one::

    w_ij = a_ij (1 + e_ij)² / g_j

with the output ``e`` of an encoder, convolutions along the ray (`encoder`) of features on which
optics may depend (`ray_features`). It is zero at first: the weights are then the segment lengths.
The gauge ``g`` keeps the mean weight in each voxel at the mean length, and so the unit. What
formulas describe, gains and gas, is found before this (`tomo.inference`); the encoder learns what
no formula covers.

1. The classic solve that predicts left-out pixels best is the baseline.
2. Outer iterations (`outer_iterations`) alternate between encoder and voxels. The encoder is
   trained at fixed voxels (`training`), and the voxels are solved for again with the weights that
   it gives. At voxels that are optimal for the weights, the gradient of the loss by the encoder is
   that with the voxels eliminated (envelope theorem), so that the alternation descends on it, but
   for the gauge, which training leaves out.
3. All of this is done without every eighth block of pixels (`left_out`). An encoder is kept where
   it predicts these better by more than chance; otherwise the result is the baseline.

`wernet` is the method of that name.

References
----------
Pan, Li, Xu, arXiv 2010.00893.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "encoder": ["CorrectionEncoder"],
        "learned_weights": ["LearnedWeights", "Profile"],
        "left_out": ["LeftOut"],
        "ray_features": ["RayFeatures"],
        "ray_weights": ["RayWeights"],
        "wernet": ["wernet"],
    },
)
