"""A video of the light along the line of sight, H.264 in an mp4 file: picture by picture."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

from rigs.files import atomic_path
from tomo.draw.emission import brightest_integral
from tomo.draw.film import FilmPicture
from tomo.draw.frame import UP
from tomo.export.export import Frames

RATE = 25
"""Pictures a second. High-speed films play slowly, the time stands in the picture."""

QUALITY = "18"
"""Constant rate factor of H.264: 18 shows no artefacts, 23 is its default, 0 is lossless."""


def write_film(frames: Frames, target: Path) -> None:
    """Write a film: a picture a frame, on one colour scale for all."""
    import av

    store = frames.store
    full = max(brightest_integral(one, UP) for one in frames.volumes("scale: "))
    picture = FilmPicture(store.volume(frames.places[0]), full, store.path.stem)
    unit = store.attributes["time_unit"]
    with atomic_path(target) as temporary, av.open(str(temporary), "w", format="mp4") as film:
        stream = None
        for time, number, volume in zip(
            frames.times, frames.numbers, frames.volumes("film: "), strict=True
        ):
            label = f"frame {number}" if unit == "1" else f"{time:.6g} {unit}   frame {number}"
            image = picture.draw(volume, label)
            if stream is None:
                stream = film.add_stream("libx264", Fraction(RATE), options={"crf": QUALITY})
                stream.pix_fmt = "yuv420p"
                stream.height, stream.width = image.shape[:2]
            film.mux(stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")))
        if stream is not None:
            film.mux(stream.encode(None))
