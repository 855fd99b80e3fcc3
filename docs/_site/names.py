"""Names in docstrings: links where the name is on a page, a warning where it does not exist."""

from pkgutil import resolve_name

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

from .api import ROOTS


def resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, contents: nodes.Element
) -> nodes.Element | None:
    """Link a name of ours by the name it is described under, or show it as code if it is private.

    None, which warns, is returned for a name of these packages that does not exist.
    """
    target = node.get("reftarget", "")
    if node.get("refdomain") != "py" or target.split(".")[0] not in ROOTS or "." not in target:
        return None
    try:
        value = resolve_name(target)
    except (AttributeError, ImportError):
        parent, _, field = target.rpartition(".")
        return contents if _has_field(parent, field) else None
    own = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
    objects = env.domains.python_domain.objects
    if own in objects:
        place = objects[own]
        return make_refnode(
            app.builder, node["refdoc"], place.docname, place.node_id, contents, own
        )
    return contents


def _has_field(parent: str, field: str) -> bool:
    """Return whether a class declares a field without a default, which is no attribute of it."""
    try:
        return field in getattr(resolve_name(parent), "__annotations__", {})
    except (AttributeError, ImportError):
        return False


def setup(app: Sphinx) -> dict:
    """Register what is asked about names that Sphinx does not know."""
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
