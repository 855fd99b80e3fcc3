"""Copy the pages to where Sphinx may write: out/docs/source, with the links that a site needs.

The pages link to files as they lie in the project. On the site an example is a page of the
gallery, and CONTRIBUTING.md and CHANGELOG.md are pages beside the others. Each section of index.md
becomes a page of its own that lists the pages of the section. Files that did not change keep their
time, so that Sphinx reads again only what changed.
"""

import re
import shutil
from pathlib import Path

from . import api

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
BUILD = ROOT / "out/docs"
BESIDE = ("CONTRIBUTING.md", "CHANGELOG.md")  # pages that lie above docs/
LINK = re.compile(r"(\]\()([^)\s:#]+)((?:#[^)\s]*)?\))")
# The parts of the site, in the order of its menu: the folder, and its section in index.md.
PARTS = {
    "guide": "Guide",
    "gallery": None,
    "api": None,
    "reference": "Reference",
    "theory": "Theory",
    "results": "Results",
    "develop": "Development",
}


def stage(build: Path = BUILD) -> None:
    """Bring out/docs/source and out/docs/examples up to date with docs/ and the docstrings."""
    pages = {path: path.relative_to(DOCS).as_posix() for path in sorted(DOCS.rglob("*.md"))}
    pages |= {ROOT / name: name for name in BESIDE}
    examples = pages.pop(DOCS / "examples/README.md")
    wanted = {name: site_links(path, path.read_text("utf-8")) for path, name in pages.items()}
    wanted["index.md"] += contents([f"{part}/index" for part in PARTS])
    index = (DOCS / "index.md").read_text("utf-8")
    for folder, title in PARTS.items():
        if title:
            wanted[f"{folder}/index.md"] = section_page(folder, title, index)
    wanted |= {f"api/{name}": text for name, text in api.pages().items()}
    for path in sorted(DOCS.rglob("*")):
        if path.suffix in (".png", ".gif", ".json"):
            wanted[path.relative_to(DOCS).as_posix()] = path.read_bytes()
    bring_up_to_date(build / "source", wanted, keep="gallery")

    scripts = {path.name: path.read_bytes() for path in (DOCS / "examples").glob("*.py")}
    scripts["GALLERY_HEADER.rst"] = header((DOCS / examples).read_text("utf-8"))
    bring_up_to_date(build / "examples", scripts)
    for page in (build / "source/gallery").glob("*.py"):
        if page.name not in scripts:  # the gallery keeps the pages of examples that are gone
            for made in page.parent.glob(f"{page.stem}.*"):
                made.unlink()


def site_links(page: Path, text: str) -> str:
    """Return a page's text with its links to files changed to links to the site's pages."""

    def changed(match: re.Match) -> str:
        target = (page.parent / match[2]).resolve()
        if target.parent == DOCS / "examples":
            name = "index" if target.suffix == ".md" else target.stem
            path = f"gallery/{name}.rst"
        elif target.parent == ROOT and target.name in BESIDE:
            path = target.name
        else:
            return match[0]
        up = len(page.relative_to(DOCS).parts) - 1 if page.is_relative_to(DOCS) else 0
        return f"{match[1]}{'../' * up}{path}{match[3]}"

    if page.parent == ROOT:
        text = re.sub(r"\]\(docs/", "](", LINK.sub(changed, text))
        return text
    return LINK.sub(changed, text)


def contents(names: list[str]) -> str:
    """Return a hidden table of contents, in Markdown."""
    return "\n".join(["", "```{toctree}", ":hidden:", "", *names, "```", ""])


def section_page(folder: str, title: str, index: str) -> str:
    """Return the page of a section of index.md: its list, linked as seen from the folder."""
    section = index.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    section = site_links(DOCS / "index.md", section)
    named = [match[2] for match in LINK.finditer(section)]
    section = LINK.sub(lambda match: f"{match[1]}../{match[2]}{match[3]}", section)
    section = section.replace(f"](../{folder}/", "](")
    names = ["/" + re.sub("[.](md|rst)$", "", name) for name in named]
    return f"# {title}\n{section}" + contents(names)


def header(text: str) -> str:
    """Return the Markdown above the gallery, a title and plain paragraphs, as reStructuredText."""
    title, _, rest = text.partition("\n")
    title = title.removeprefix("# ")
    return f"{title}\n{'=' * len(title)}\n{rest.replace('`', '``')}"


def bring_up_to_date(folder: Path, wanted: dict[str, str | bytes], keep: str = "") -> None:
    """Write the files that changed and remove those that are not wanted, but for `keep`."""
    for path in sorted(folder.rglob("*"), reverse=True):
        name = path.relative_to(folder).as_posix()
        if keep and name.split("/")[0] == keep:
            continue
        if path.is_dir():
            if not any(path.iterdir()):
                path.rmdir()
        elif name not in wanted:
            path.unlink()
    for name, content in wanted.items():
        path = folder / name
        data = content.encode() if isinstance(content, str) else content
        if path.is_file() and path.read_bytes() == data:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


if __name__ == "__main__":
    shutil.rmtree(BUILD / "examples", ignore_errors=True)
    stage()
