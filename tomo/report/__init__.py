"""The report of a reconstruction: report.html, report.json and pictures."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "ahead": ["Ahead"],
        "artist": ["Artist"],
        "outcome_files": ["write_outcome"],
        "report": ["write_report"],
        "series": ["series_report", "write_series_outcome"],
        "pictures": ["Picture", "draw", "write_pictures"],
    },
)
