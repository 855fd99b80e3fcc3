"""The viewer: a rig, a volume or a film in a page that a server on this machine keeps up to date.

`show` is all that a notebook needs. `content_of` reads what to show, `Viewer` shows it by viser on
127.0.0.1. What makes arrays of values stands in modules of its own, which know no server:
`surfaces`, `colours`, `rendering`, `comparison`.
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
        "showing": ["content_of", "show"],
        "viewer": ["Viewer"],
    },
)
