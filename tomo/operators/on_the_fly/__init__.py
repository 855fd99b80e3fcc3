"""The projection without a stored matrix: exact segment lengths, computed at every product.

Method. Each ray has a *driving axis* ``a``, along which it advances most in voxels; ``b`` and
``c`` are the two others, and ``t`` the position along ``a`` in voxels. A *column* is the row of
``n_a`` voxels at one ``(b, c)``. Its running sums are

    S[0] = 0,   S[k + 1] = S[k] + x[k],   F(t) = S[k] + (t - k) (S[k + 1] - S[k]),  k = floor(t).

A ray that is in one column from ``t0`` to ``t1`` crosses each of its voxels along the part of
``[t0, t1]`` inside that voxel, so its line integral there is ``F(t1) - F(t0)``, times the length
of one voxel step. With entry ``t_in``, exit ``t_out``, and face crossings at ``t_1 < ... < t_m``
where the ray leaves column ``j - 1`` for column ``j``,

    (A x)_ray = length per step * ( F_m(t_out) - F_0(t_in) + sum_j [F_{j-1}(t_j) - F_j(t_j)] ).

Work grows with the face crossings, two reads of two numbers each, not with the voxels on the way.

Adjoint. A pixel's value goes where the forward product reads: ``1 - (t - k)`` of it to ``D[k]``
and ``t - k`` to ``D[k + 1]``, with the same signs. A voxel then gets the sum of its column's ``D``
behind it. ``D`` is kept in whole multiples of a power of two, near 2^-61 of the largest possible
sum, so that sums are exact in any order and a column no ray meets gets zero.

Exactness. Crossings are computed from their number, never accumulated, in float64. Products with
float64 agree with the stored matrix to about 1e-13 of the largest value, with float32 to about
1e-7 of the largest running sum.

Determinism. Each pixel, and in the adjoint each range of columns, belongs to one thread at a time:
results have the same bits on any number of threads.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "attenuated": ["AttenuatedProjector"],
        "projector": ["OnTheFlyProjector"],
    },
)
