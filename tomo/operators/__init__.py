"""Linear operators from the unknowns to the pixels, each with its exact adjoint.

An operator ``A`` is a `scipy.sparse.linalg.LinearOperator` that knows its views::

    images = A @ x               # (pixels,) of the unknowns (unknowns,)
    back_projection = A.T @ y    # (unknowns,) of (pixels,)

Its rows are pixels, view after view (``A.view_ptr``); its columns are the active voxels of
``A.grid``. `dot_test` measures that the adjoint is exact, and `LinearSystem` makes the operator of
a rig's pixels.

**Rays in voxels.** `Projector` stores the length of every ray in every voxel; the projector of
`tomo.operators.on_the_fly` computes them anew at every product, to the same result.

**Composition.** An effect on the images stands on the left, other basis functions on the right,
``B A M`` (`tomo.operators.composition`)::

    lens_blur(rig, pixels, grid, 0.5) @ A                         # lenses out of focus
    LinearBasis(footprint_blur(rig, pixels, seen, grid) @ A)      # linear between voxel centres
    GaussianBasis(A, width)                                       # blobs at the voxel centres

Gas that absorbs changes the rays' weights, not the composition: `LinearSystem.with_absorption`
gives every segment the fraction of its light that arrives (`Absorption`), along whole paths of
light where rays are several pieces one behind the other.

A composition is an operator of the same kind, so that compositions compose. `ImageBlur` is the
blur ``B`` of images by one kernel a view, whatever the kernel is made of. Gains and backgrounds
of the cameras make the model affine, ``b = g (A x) + o``: `Gains` applies both to the images and
corrects images by both, and ``A`` stays linear.

**What an operator is, it says itself**: ``A.basis``, the basis functions of its unknowns;
``A.rows_are_single_rays``, whether a row holds the rays of one pixel alone; ``A.matrix``, the
stored entries, or None; ``A.without_blur``, the operator before an image blur. Solvers and
choosers ask these, never for a type. ``A.voxel_means`` turns coefficients into the mean emission
of every voxel, which volumes are reported in, and ``A.on_voxel_means`` projects those.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "absorption": ["TRANSPARENT", "Absorption", "extinction_of"],
        "basis": ["GaussianBasis", "LinearBasis", "coefficients_of", "voxel_means"],
        "footprint": ["footprint_blur"],
        "composition": ["BasisProjector", "ComposedProjector", "ImageOperator"],
        "image_blur": ["ImageBlur"],
        "image_of": ["image_of"],
        "lens_blur": ["lens_blur"],
        "memory": [
            "BYTES_PER_MIDPOINT",
            "BYTES_PER_RAY",
            "BYTES_PER_SEGMENT",
            "BYTES_PER_VOXEL",
            "MemoryNeed",
            "ON_THE_FLY",
            "SAMPLED_RAYS",
            "STORED",
            "choose_form",
            "estimate_memory",
        ],
        "operator": ["LINEAR", "VOXEL", "ProjectionOperator", "dot_test"],
        "stored": ["Projector"],
        "system": ["LinearSystem"],
        "timing": ["Effort", "estimate_effort"],
        "view_gains": ["Gains"],
    },
)
