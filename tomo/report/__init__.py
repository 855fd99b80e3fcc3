"""The report of a reconstruction: report.html, report.json and pictures."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "report": ["write_report"],
        "content": ["Convergence", "Results"],
        "pictures": ["Picture", "draw", "write_pictures"],
    },
)
