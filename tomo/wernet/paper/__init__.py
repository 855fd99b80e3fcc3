"""The published WERNet: Pan, Li, Xu, arXiv 2010.00893.

A ray ``i`` with the segments ``j`` predicts its pixel from voxels ``x`` and weights ``w``::

    p_i = sum_j w_ij x_j,    w_ij = E(f_i1, f_i2, ...)_j^2

The encoder ``E`` (`encoder.WeightEncoder`) is a stack of convolutions along the ray: kernel 3, 32
channels, batch normalisation or a bias, Leaky ReLU, and a mask. Its last layer has one channel,
the weight's root. The features ``f`` are six numbers a segment: the voxel's index and the
segment's midpoint (`samples.RaySamples`). Voxels and encoder are trained together by Adam with a
learning rate each, halved every five epochs, on the loss of some rays ::

    mean (p - m)^2

The gradient of a voxel is normalised by its ray's weights, ``g w / norm(w)``
(`product.weighted_sum`). Segments are packed one behind another with one empty row between rays,
instead of padded to the longest ray as in the paper; both forms give the same weights.

The factorisation fixes no scale: weights times ``c`` and voxels divided by ``c`` predict the same.
Two steps are therefore ours, not the paper's. The measurement is divided by its maximum, so that
learning rates mean the same in every unit. The voxels are reported as ``s x``, with the matrix
``A`` of segment lengths::

    s = <A x, m> / <A x, A x>

the scale at which their ordinary projection fits the measurement best. A factor that varies in
space is not undone by this: an encoder that sees absolute positions can hide one while the loss
falls. With ``inputs="relative"`` it sees the position within the voxel and the ray's direction.

An encoder trained on one scene is used on another by ``encoder=`` and ``freeze_encoder=True``, the
paper's transfer; `tomo.wernet.save_encoder` writes ``Solution.encoder`` to a file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "encoder": ["WeightEncoder"],
        "model": ["WERNet"],
        "product": ["packed_sum", "weighted_sum"],
        "samples": ["PackedBatch", "RaySamples", "SampleBatch", "epoch_batches"],
        "wernet_paper": ["TrainingDivergedError", "wernet_paper"],
    },
)
