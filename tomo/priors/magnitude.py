"""The prior that unknowns are small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Magnitude:
    """The identity: ``||x||²`` counts the unknowns themselves."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``x``."""
        return values

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``p``."""
        return field
