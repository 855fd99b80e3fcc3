"""The pages of the API reference: one for each public package, made from what `__all__` names.

An object that several packages name is described once, where users import it from; the other pages
link there.
"""

import importlib
import inspect
import pkgutil
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
    homes, own = {}, {}
    for module in modules:
        own[module] = []
        for name in public_names(module):
            value = getattr(importlib.import_module(module), name)
            if isinstance(value, ModuleType):
                continue
            home = homes.setdefault(_identity(module, name, value), f"{module}.{name}")
            own[module].append((name, value, home))
    taken = set(homes.values())  # tomo.trace is a function and a package
    written = {f"{module}.rst": _page(module, own[module], module in taken) for module in modules}
    listed = ""
    for root in ROOTS:
        below = "\n   ".join(name for name in modules if name.split(".")[0] == root)
        listed += f".. toctree::\n   :maxdepth: 1\n\n   {below}\n\n"
    return {"index.rst": INTRODUCTION + listed} | written


def _identity(module: str, name: str, value: object) -> tuple | int:
    """Return what tells objects apart: constants of equal value are different names."""
    callable_ = inspect.isclass(value) or inspect.isroutine(value)
    return id(value) if callable_ else (module, name)


def _page(module: str, names: list[tuple[str, object, str]], taken: bool) -> str:
    here = [(name, value) for name, value, home in names if home == f"{module}.{name}"]
    elsewhere = [home for name, _, home in names if home != f"{module}.{name}"]
    index = "\n   :no-index:" if taken else ""
    parts = [f"{module}\n{'=' * len(module)}", f".. automodule:: {module}{index}"]
    parts.append(f".. currentmodule:: {module}")
    if elsewhere:
        links = ", ".join(f":py:obj:`{home}`" for home in elsewhere)
        parts.append(f"Described elsewhere: {links}.")
    if len(here) > 1:
        table = "\n   ".join(name for name, _ in here)
        parts.append(f".. autosummary::\n   :nosignatures:\n\n   {table}")
    parts += [_entry(module, name, value) for name, value in here]
    return "\n\n".join(parts) + "\n"


def _entry(module: str, name: str, value: object) -> str:
    title = f"{name}\n{'-' * len(name)}"
    if inspect.isclass(value):
        return f"{title}\n\n.. autoclass:: {module}.{name}\n   :members:"
    if callable(value):
        return f"{title}\n\n.. autofunction:: {module}.{name}"
    return f"{title}\n\n.. autodata:: {module}.{name}"
