"""A scan of the images in a folder: what is found by names, contents and where cameras look."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "contents": ["Request", "UndecidedError"],
        "proposal": ["Proposal", "propose_scan"],
        "write": ["WRITTEN", "write_proposal"],
    },
)
