"""Reading XML files into elements; entities and deep nesting are refused."""

from __future__ import annotations

import os
import re
from xml.etree import ElementTree

from rigs.files.text import MAX_DEPTH, read_text


class _Guarded(ElementTree.TreeBuilder):
    """A builder of trees that are not deep."""

    depth = 0

    def start(self, tag: str, attributes: dict[str, str]) -> ElementTree.Element:
        """Open an element, or refuse it."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ValueError("broken XML: nested too deeply")
        return super().start(tag, attributes)

    def end(self, tag: str) -> ElementTree.Element:
        """Close an element."""
        self.depth -= 1
        return super().end(tag)


def read_xml(path: str | os.PathLike) -> ElementTree.Element:
    """Return the root element of the XML file at ``path``, of a document without entities.

    A few lines of those may expand to any amount of text, or name other files.
    """
    return parse_xml(read_text(path), path)


def parse_xml(text: str, path: str | os.PathLike) -> ElementTree.Element:
    """Return the root element of a text; errors name the file that it stands in."""
    if not text.strip():
        raise ValueError(f"{path}: found an empty file, expected XML")
    if re.search(r"<!ENTITY", text):
        raise ValueError(f"{path}: found an XML entity declaration, expected plain elements")
    parser = ElementTree.XMLParser(target=_Guarded())
    try:
        parser.feed(text)
        return parser.close()
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: broken XML: {error}") from None
    except (ValueError, UnicodeError, LookupError) as error:
        raise ValueError(f"{path}: {error}") from None
