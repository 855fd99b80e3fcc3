"""The first use of a glossary term on a page becomes a link to the term."""

import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

PAGE = "reference/glossary"
# Terms that pages also use as everyday words: a link would mislead.
EVERYDAY = frozenset({
    "background", "chunk", "effect", "finding", "fold", "frame", "grid", "null", "offset", "path",
    "resolution", "scan", "scene", "score", "trust", "view",
})  # fmt: skip
NOT_IN = (nodes.reference, nodes.title, nodes.literal, nodes.term, nodes.rubric, nodes.table)


def terms_of(glossary: nodes.document) -> dict[str, tuple[str, str]]:
    """Return the terms in lower case: the anchor and the first sentence of each."""
    found = {}
    for section in glossary.findall(nodes.section):
        title = section.next_node(nodes.title).astext()
        paragraph = section.next_node(nodes.paragraph)
        if paragraph is None or section.parent is glossary:
            continue
        meaning = re.split(r"(?<=[.]) ", paragraph.astext().replace("\n", " "))[0]
        for term in terms_in(title):
            found[term] = (section["ids"][0], meaning)
    return found


def terms_in(title: str) -> list[str]:
    """Return the terms of a heading such as ``Stored matrix, on the fly``, in lower case."""
    terms = (part.strip().lower() for part in re.split(r", | and |[()]", title))
    return [term for term in terms if term and term not in EVERYDAY]


class LinkTerms(SphinxPostTransform):
    """Link the first use of each term in the paragraphs of a page, with its meaning as a tip."""

    default_priority = 400

    def run(self, **kwargs: object) -> None:
        """Go through the page's text once, from top to bottom."""
        if self.env.docname == PAGE or self.env.docname.endswith("index"):
            return
        terms = terms_of(self.env.get_doctree(PAGE))
        words = "|".join(sorted(map(re.escape, terms), key=len, reverse=True))
        pattern = re.compile(rf"\b({words})(s|es)?\b(?![-.]\w)", re.IGNORECASE)
        for text in list(self.document.findall(nodes.Text)):
            if terms and _is_prose(text):
                self.link(text, terms, pattern)

    def link(self, text: nodes.Text, terms: dict, pattern: re.Pattern) -> None:
        """Replace the terms in one text that the page has not used before."""
        parts, done = [], 0
        for match in pattern.finditer(text):
            before = text[: match.start()].rstrip()
            if match[0].istitle() and before and before[-1] not in ".:?":
                continue  # a proper name: Phantom cameras
            anchor, meaning = terms.pop(match[1].lower(), (None, None))
            if anchor:
                parts += [nodes.Text(text[done : match.start()]), self.reference(match[0], anchor)]
                parts[-1]["reftitle"] = meaning
                done = match.end()
        if parts:
            text.parent.replace(text, [*parts, nodes.Text(text[done:])])

    def reference(self, word: str, anchor: str) -> nodes.reference:
        """Return the link of a word to its place in the glossary."""
        builder = self.app.builder
        uri = builder.get_relative_uri(self.env.docname, PAGE) + f"#{anchor}"
        return nodes.reference("", word, internal=True, refuri=uri, classes=["term"])


def _is_prose(text: nodes.Text) -> bool:
    node, in_paragraph = text.parent, False
    while node is not None:
        if isinstance(node, NOT_IN):
            return False
        in_paragraph |= isinstance(node, nodes.paragraph)
        node = node.parent
    return in_paragraph


def setup(app: Sphinx) -> dict:
    """Register the links; a change of the glossary is seen where pages are written again."""
    app.add_post_transform(LinkTerms)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
