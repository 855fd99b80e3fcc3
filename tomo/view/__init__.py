"""The viewer: a rig, a volume or a film in a page that a program on this machine serves.

`show` is all that a notebook needs. `content_of` reads what to show; `page` makes the scene and
the look of the pages without a server of it; `Viewer` serves it on 127.0.0.1 and answers when the
page asks for a frame, the images of a moment, or one camera beside the volume.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "content": ["Content"],
        "opening": [
            "content_of_film",
            "content_of_outcome",
            "content_of_result",
            "content_of_rig",
            "content_of_volume",
        ],
        "showing": ["content_of", "show", "Viewer"],
    },
)
