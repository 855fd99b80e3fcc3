"""Stores of series as files of other programs, as films, and as statistics over time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"export": ["FORMATS", "export_series"]}
)
