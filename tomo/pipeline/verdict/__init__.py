"""How far to trust a volume: green, amber or red, the reasons, and what to do next."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "value": ["Verdict", "LEVELS", "GREEN", "AMBER", "RED", "MEANS"],
        "facts": ["expected_error", "least_measured"],
        "rules": ["RULES", "Rule", "judge", "rules_that_apply", "worst_of"],
    },
)
