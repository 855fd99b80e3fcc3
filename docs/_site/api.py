"""The pages of the API reference: one for each public package, made from what `__all__` names.

An object that several packages name is described once, under the name that users import it by and
on the page of its subject; the other pages link there.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable
from types import ModuleType

ROOTS = ("tomo", "rigs", "phantoms")
INTRODUCTION = """\
API
===

The names that programs may use. `tomo` follows a volume from images to the report, `rigs` knows
cameras, `phantoms` knows emissions in continuous space. The names in use every day are in these
three; each package below them has the names of one subject.

"""


def public_modules() -> list[str]:
    """Return the names of the modules with public names, roots first, then by the alphabet."""
    found = list(ROOTS)
    for root in ROOTS:
        package = importlib.import_module(root)
        for module in pkgutil.iter_modules(package.__path__, f"{root}."):
            name = module.name.rpartition(".")[2]
            if not name.startswith("_") and (module.ispkg or name in package.__all__):
                found += [module.name] * bool(public_names(module.name))
    return found


def public_names(module: str) -> list[str]:
    """Return the names that a module lists in `__all__`, or defines without an underscore."""
    values = vars(found := importlib.import_module(module))
    if names := getattr(found, "__all__", None):
        return sorted(names, key=str.lower)
    names = [name for name in values if not name.startswith("_")]
    return [name for name in names if getattr(values[name], "__module__", "") == module]


def pages() -> dict[str, str]:
    """Return the pages in reStructuredText by their file names."""
    modules = public_modules()
    homes: dict[tuple | int, str] = {}
    named: dict[str, list[str]] = {module: [] for module in modules}  # full names
    described: dict[str, list[tuple[str, object]]] = {module: [] for module in modules}
    for module in modules:
        for name in public_names(module):
            value = getattr(importlib.import_module(module), name)
            if isinstance(value, ModuleType):
                continue
            own = f"{module}.{name}"
            home = homes.setdefault(_identity(module, name, value), own)
            named[module].append(home)
            if home == own:
                subject = ".".join(getattr(value, "__module__", "").split(".")[:2])
                page = subject if module in ROOTS and subject in modules else module
                described[page].append((home, value))
    taken = set(homes.values())  # tomo.trace is a function and a package
    places = {name: page for page, entries in described.items() for name, _ in entries}
    written = {
        f"{module}.rst": _page(module, named[module], described[module], places, module in taken)
        for module in modules
    }
    listed = ""
    for root in ROOTS:
        below = "\n   ".join(name for name in modules if name.split(".")[0] == root)
        listed += f".. toctree::\n   :maxdepth: 1\n\n   {below}\n\n"
    return {"index.rst": INTRODUCTION + listed} | written


def _identity(module: str, name: str, value: object) -> tuple | int:
    """Return what tells objects apart: constants of equal value are different names."""
    callable_ = inspect.isclass(value) or inspect.isroutine(value)
    return id(value) if callable_ else (module, name)


def _page(
    module: str,
    names: list[str],
    entries: list[tuple[str, object]],
    places: dict[str, str],
    taken: bool,
) -> str:
    index = "\n   :no-index:" if taken else ""
    parts = [f"{module}\n{'=' * len(module)}", f".. automodule:: {module}{index}"]
    parts.append(f".. currentmodule:: {module}")
    here = [name for name, _ in entries]
    elsewhere = [name for name in names if name not in here]
    if module in ROOTS:
        for page in dict.fromkeys(sorted(places[name] for name in elsewhere)):
            parts.append(f":doc:`{page}`")
            parts.append(_table(module, (name for name in elsewhere if places[name] == page)))
    elif elsewhere:
        links = ", ".join(f":py:obj:`{name}`" for name in elsewhere)
        parts.append(f"Described elsewhere: {links}.")
    if len(here) > 1:
        parts.append(_table(module, here))
    parts += [_entry(name, value) for name, value in entries]
    return "\n\n".join(parts) + "\n"


def _table(module: str, names: Iterable[str]) -> str:
    own = f"{module}."
    listed = "\n   ".join(
        name.removeprefix(own) if name.startswith(own) else f"~{name}" for name in names
    )
    return f".. autosummary::\n   :nosignatures:\n\n   {listed}"


def _entry(full: str, value: object) -> str:
    name = full.rpartition(".")[2]
    title = f"{name}\n{'-' * len(name)}"
    if inspect.isclass(value):
        # members of bases too, as far as these are ours
        other = next(one for one in value.__mro__ if one.__module__.split(".")[0] not in ROOTS)
        inherited = f"\n   :inherited-members: {other.__name__}"
        return f"{title}\n\n.. autoclass:: {full}\n   :members:{inherited}"
    if callable(value):
        return f"{title}\n\n.. autofunction:: {full}"
    return f"{title}\n\n.. autodata:: {full}"
