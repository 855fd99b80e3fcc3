"""One image as its file holds it: numbers, the number that is full scale, and its channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CHANNELS = ("r", "g", "b")
MOST_BITS = 32  # of an integer: float32 holds the sums of no larger ones


@dataclass(frozen=True, eq=False)
class Still:
    """An image as stored, row 0 first, whatever the file says about the way it is viewed.

    Attributes
    ----------
    pixels : (rows, columns) or (rows, columns, channels) array
        Channels are grey and alpha, or red, green, blue and alpha.
    full_scale : int or None
        The largest number that the recorded bits hold: 4095 for 12 bits, however they are stored.
        None for floating-point numbers.
    is_mosaic : bool
        Whether the file says that neighbouring pixels have filters of different colours.
    """

    pixels: NDArray
    full_scale: int | None
    is_mosaic: bool = False

    @classmethod
    def of(cls, pixels: NDArray, bits: int | None = None, is_mosaic: bool = False) -> Still:
        """Return the image of ``pixels`` of which ``bits`` are recorded; all of them when None.

        Truth values become black and white, 0 and 255, as other formats have them.
        """
        if pixels.dtype == np.bool_:
            pixels, bits = pixels * np.uint8(255), 8
        kind, size = pixels.dtype.kind, pixels.dtype.itemsize
        if kind == "f":
            return cls(pixels, None, is_mosaic)
        if kind not in "iu" or 8 * size > MOST_BITS:
            raise ValueError(
                f"found {pixels.dtype} pixels, expected integers of at most {MOST_BITS} bits "
                "or floating point"
            )
        bits = bits or 8 * size
        return cls(pixels, 2 ** (bits - (kind == "i")) - 1, is_mosaic)

    @property
    def is_grey(self) -> bool:
        """Whether there is one number a pixel."""
        return self.pixels.ndim == 2

    def grey(self, channel: str | None = None) -> NDArray:
        """Return the image ``(rows, columns)``: a channel, or the grey that all channels show.

        ``channel`` is r, g, b, or the number of one of any channels. Unequal colours without it,
        and transparent pixels, whose values are not known, are refused.
        """
        if self.is_grey:
            return self.pixels
        count = self.pixels.shape[2]
        number = int(channel) if channel is not None and channel.isdigit() else None
        if number is not None and number < count:
            return self.pixels[:, :, number]
        if number is not None or count > len(CHANNELS) + 1:
            raise ValueError(
                f"found {count} channels, expected 0 to {count - 1}, one of them: channel='0', or "
                "corrections: {channel: 0} in scan.yaml, or one stored alone"
            )
        if count in (2, 4):
            self._check_alpha(self.pixels[:, :, -1])
        if count <= 2:
            return self.pixels[:, :, 0]
        if channel in CHANNELS:
            return self.pixels[:, :, CHANNELS.index(channel)]
        red, *others = np.moveaxis(self.pixels[:, :, :3], -1, 0)
        if not all(np.array_equal(red, other) for other in others):
            raise ValueError(
                f"found a colour image of shape {self.pixels.shape} whose 3 channels differ, "
                "expected a grey one: choose a colour by channel='g', 'r' or 'b', or by "
                "corrections: {channel: g} in scan.yaml"
            )
        return red

    def _check_alpha(self, alpha: NDArray) -> None:
        full = self.full_scale or 1
        clear = np.count_nonzero(alpha != full)
        if clear:
            raise ValueError(
                f"found {clear} transparent pixels, with alpha down to {alpha.min():g} of {full}, "
                "expected none: store the image without alpha, or take a channel by its number, "
                "like channel='0'"
            )
