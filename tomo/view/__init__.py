"""The viewer: a rig, a volume or a film in a page that a server on this machine keeps up to date.

`open_content` reads what to show, `Viewer` shows it by viser on 127.0.0.1. What makes arrays of
values stands in modules of its own, which know no server: `surfaces`, `colours`, `rendering`,
`comparison`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "content": ["Content"],
        "opening": [
            "content_of_film",
            "content_of_outcome",
            "content_of_rig",
            "content_of_volume",
        ],
        "viewer": ["Viewer"],
    },
)
