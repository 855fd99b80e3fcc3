"""How far a calibration can be trusted, in length units in the volume."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"quality": ["Quality"]})
