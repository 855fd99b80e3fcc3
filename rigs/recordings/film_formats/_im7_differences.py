"""DaVis' packing of images as differences from pixel to pixel, compiled: a byte or nibble each."""

import numpy as np

from rigs.compiled import compiled


@compiled
def summed(data, count):
    """Return pixels from differences, and whether there are enough of them.

    A byte is a difference to the pixel before. Byte -128: a pixel of two bytes follows; 127: so
    many of them as the next byte says; -127: from here on a nibble is a difference, until a low
    nibble is 8.
    """
    image = np.zeros(count, np.uint16)
    at, last, wide, nibbles, byte, is_low = 0, 0, 0, False, 0, False
    for place in range(count):
        if wide == 0:
            if nibbles and is_low:
                step = byte & 15
                is_low = False
                if step == 8:
                    nibbles = False
                else:
                    last += step - 16 if step > 8 else step
            elif nibbles:
                if at >= data.size:
                    return image, False
                byte = np.int64(data[at])
                at += 1
                step = byte >> 4
                is_low = True
                last += step - 16 if step >= 8 else step
            if not nibbles:
                if at >= data.size:
                    return image, False
                byte = np.int64(data[at])
                at += 1
                if byte == 128:
                    wide = 1
                elif byte == 127:
                    if at >= data.size:
                        return image, False
                    wide = np.int64(data[at])
                    wide = 256 if wide == 0 else wide  # a byte that is counted down to 0
                    at += 1
                elif byte == 129:
                    if at >= data.size:
                        return image, False
                    byte = np.int64(data[at])
                    at += 1
                    step = byte >> 4
                    nibbles, is_low = True, True
                    last += step - 16 if step >= 8 else step
                else:
                    last += byte - 256 if byte > 127 else byte
        if wide > 0:
            if at + 1 >= data.size:
                return image, False
            last = np.int64(data[at]) | np.int64(data[at + 1]) << 8
            at += 2
            wide -= 1
        last &= 0xFFFF
        image[place] = last
    return image, True
