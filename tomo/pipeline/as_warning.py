"""Steps after a volume is there, which only say something of it: it stands if they fail."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def as_warning(step: str, warnings: list[str]) -> Iterator[None]:
    """Let a step fail, whatever is raised: a line about it joins the warnings."""
    try:
        yield
    except Exception as error:  # hours may have gone into the volume
        reason = " ".join(str(error).split())
        if not (reason and isinstance(error, (ValueError, RuntimeError))):
            reason = f"{type(error).__name__}: {reason}".removesuffix(": ")
        warnings.append(f"{step}: {reason}")
