"""The default WERNet: segment lengths corrected by what the images ask for.

The classic model predicts a pixel by ``p_i = sum_j a_ij x_j`` with the segment lengths ``a``. Here
each length is corrected by a factor near one::

    w_ij = a_ij (1 + c_ij)^2,    1 + c_ij = (1 + e_ij) exp(k . t_ij + g_v)

with the gain ``exp(g_v)`` of view ``v``, three coefficients ``k`` of global terms ``t``, and the
output ``e`` of an encoder, convolutions along the ray (`correction`). The terms are the depth in
the grid (even absorption), the upstream emission (self-absorption) and the squared tangent off the
optical axis (vignetting). All are zero at first: the weights are then the segment lengths, and
units are kept.

1. The classic solve that predicts left-out pixels best is the baseline.
2. Gains and coefficients are found by variable projection (`variable_projection`): Gauss-Newton
   steps on the residual ``m - A(g, k) x(g, k)``, the voxels ``x`` eliminated. Residuals are summed
   over patches of the images, where errors of single pixels cancel.
3. Outer iterations (`outer_iterations`) alternate between encoder and voxels. The encoder is
   trained at fixed voxels (`encoder_training`, `fixed_voxels`) on the loss ::

       mean (p - m)^2 / mean m^2  +  1e-3 mean c^2

   and the voxels are solved for again with the weights that it gives. At voxels that are optimal
   for the weights, the gradient of the loss by the encoder is that with the voxels eliminated
   (envelope theorem), so that the alternation descends on that loss.
4. All of this is done without every eighth block of pixels (`left_out`). Terms and encoders are
   kept where they predict these better by more than chance; otherwise the result is the baseline.
   With eight views or fewer only what is common to all views is learned.

`wernet` is the method of that name.

The encoder's forward pass stands in `ray_weights.packed_corrections` (PyTorch, for training) and
in `compiled_forward` (its compiled twin, for whole volumes).

References
----------
Pan, Li, Xu, arXiv 2010.00893 (the encoder). Golub, Pereyra, "The differentiation of
pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM Journal on
Numerical Analysis 10 (1973) (variable projection).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "correction": ["CorrectionEncoder", "ViewParameters"],
        "learned_weights": ["LearnedWeights", "Profile"],
        "left_out": ["LeftOut"],
        "ray_features": ["RayFeatures"],
        "ray_weights": ["RayWeights"],
        "wernet": ["wernet"],
    },
)
