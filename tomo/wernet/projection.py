"""Differentiable projection: pixels of a volume in torch, gradients by the exact adjoint."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem, ProjectionOperator


def project(volume: torch.Tensor, equations: ProjectionOperator | LinearSystem) -> torch.Tensor:
    """Return the pixels ``A x`` of a volume, differentiable as often as asked for.

    Parameters
    ----------
    volume : (..., nx, ny, nz) or (..., voxels) or (..., unknowns) tensor
        Emission, or coefficients where the operator has another basis; float32 or float64.
        Dimensions before are a batch.
    equations : ProjectionOperator or LinearSystem
        Any operator of `tomo.operators`: stored or on the fly, blurred, of any basis.

    Returns
    -------
    (..., pixels) tensor
        Of the type and on the device of the volume. An operator on the same device
        (`tomo.operators.gpu.on_device`) computes it there; any other on the CPU: a tensor on
        another device is copied there, and its pixels back.

    Raises
    ------
    ValueError
        If the volume has another shape or type, or values that are not finite.

    Notes
    -----
    The gradient of a loss ``L`` by the volume is ``A^T dL/dm``, with the operator's own adjoint:
    exact to 1e-12 in float64 and 1e-6 in float32 (`tomo.dot_test`). `torch.func` serves too:
    ``grad, vjp, jvp, vmap, jacrev``.

    Examples
    --------
    >>> volume = torch.zeros(grid.shape, requires_grad=True)                     # doctest: +SKIP
    >>> loss = (tomo.wernet.project(volume, system) - measured).square().sum()   # doctest: +SKIP
    >>> loss.backward()                                                          # doctest: +SKIP
    """
    operator = equations.projector if isinstance(equations, LinearSystem) else equations
    flat = as_unknowns(volume, operator.active)
    batch, unknowns = flat.shape[:-1], flat.shape[-1]
    if not batch:
        return Product.apply(flat, operator)
    return Product.apply(flat.reshape(-1, unknowns).T, operator).T.reshape(*batch, -1)


class Product(torch.autograd.Function):
    """``A x`` of ``(unknowns,)`` or ``(unknowns, columns)``; its gradient is a product by ``A^T``.

    The gradient is another such product, so that derivatives of any order are there.
    """

    @staticmethod
    def forward(x: torch.Tensor, operator: LinearOperator) -> torch.Tensor:
        """Return the product, computed on the CPU or where operator and tensor are."""
        x = x.detach().contiguous()
        if not (hasattr(operator, "takes") and operator.takes(x)):
            return as_tensor(operator @ as_array(x, "volume"), x)
        check_finite(int(torch.count_nonzero(~torch.isfinite(x))), "volume")
        return operator @ x

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: torch.Tensor) -> None:
        """Keep the operator."""
        ctx.operator = inputs[1]

    @staticmethod
    def backward(ctx: Any, *grad: torch.Tensor) -> tuple[torch.Tensor, None]:
        """Return ``A^T g``."""
        return Product.apply(grad[0], ctx.operator.T), None

    @staticmethod
    def jvp(ctx: Any, *change: torch.Tensor) -> torch.Tensor:
        """Return ``A dx``."""
        return Product.apply(change[0], ctx.operator)

    @staticmethod
    def vmap(info: Any, in_dims: tuple, x: torch.Tensor, operator: LinearOperator) -> tuple:
        """Return the products of a batch, all in one."""
        last = x.movedim(in_dims[0], -1)
        flat = Product.apply(last.reshape(len(last), -1), operator)
        return flat.reshape(-1, *last.shape[1:]), -1


def as_unknowns(volume: torch.Tensor, active: ActiveVoxels) -> torch.Tensor:
    """Return a volume, or a batch, in float32 or float64, as unknowns ``(..., unknowns)``."""
    if volume.dtype not in (torch.float32, torch.float64):
        raise ValueError(
            f"volume: found {volume.dtype}, expected torch.float32 or torch.float64: "
            "volume.float() turns it into single precision"
        )
    grid, shape = active.grid, tuple(volume.shape)
    flat = volume.flatten(-3) if shape[-3:] == grid.shape else volume
    if flat.shape[-1:] == (active.size,):
        return flat
    if flat.shape[-1:] == (grid.size,):
        return flat[..., torch.as_tensor(active.index, device=flat.device)]
    raise ValueError(
        f"volume: found shape {shape}, expected (..., nx, ny, nz) = {grid.shape}, "
        f"(..., {grid.size}) voxels or (..., {active.size}) unknowns"
    )


def as_array(tensor: torch.Tensor, name: str) -> NDArray[np.floating]:
    """Return the values of a tensor, finite ones, in memory of the CPU."""
    values = tensor.detach().cpu().numpy()
    check_finite(int(np.count_nonzero(~np.isfinite(values))), name)
    return values


def check_finite(wrong: int, name: str) -> None:
    """Raise where so many values are NaN or infinite."""
    if wrong:
        raise ValueError(f"{name}: found {wrong} NaN or infinite values, expected finite ones")


def as_tensor(values: NDArray[np.floating], like: torch.Tensor) -> torch.Tensor:
    """Return values as a tensor of the type and on the device of another."""
    return torch.as_tensor(np.ascontiguousarray(values)).to(like)
