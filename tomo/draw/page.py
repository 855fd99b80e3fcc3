"""Common parts of the HTML pages: templates and embedded pictures."""

from __future__ import annotations

import base64
import io
from importlib import resources
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL.Image import Image


def render(template: str, **values: object) -> str:
    """Return the page of a template, which may include others; values are escaped."""
    import jinja2

    def source(name: str) -> str:
        return resources.files("tomo.draw.templates").joinpath(name).read_text(encoding="utf-8")

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def embedded(png: bytes) -> str:
    """Return a PNG as a data URL for an image's ``src``."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(image: Image) -> bytes:
    """Return an image of Pillow as a small PNG."""
    buffer = io.BytesIO()
    image.save(buffer, "png", optimize=True)
    return buffer.getvalue()


def small_png(picture: NDArray[np.uint8], colours: int = 96) -> bytes:
    """Return a picture ``(rows, columns, 3)`` as a PNG of a few colours, a third of the size."""
    from PIL import Image

    return png_of(Image.fromarray(picture).quantize(colours, dither=Image.Dither.NONE))


def indexed_png(steps: NDArray[np.uint8], colours: NDArray) -> bytes:
    """Return numbers of colours ``(rows, columns)``, and the colours in 0..1, as a PNG."""
    from PIL import Image

    image = Image.fromarray(steps)
    image.putpalette(np.round(255 * colours).astype(np.uint8).tobytes())
    return png_of(image)


def script_safe(text: str) -> str:
    """Return JSON escaped for a script element: nothing in it ends the element."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
