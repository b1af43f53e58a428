# SPDX-License-Identifier: BSD-2-Clause
"""Write what the site is built from to `site_pages/`: `make_site.py && mkdocs build --strict`.

MkDocs and Zensical both build from there with `mkdocs.yml`, without hooks. To the pages of docs/
come those from the root of the repository and one for each robot of the gallery. Links that lead
out of the pages lose their target, and equations become MathML, so that a reader's browser loads no
script for them.
"""

import argparse
import html
import posixpath
import re
import shutil
from pathlib import Path

from latex2mathml.converter import convert

from robot_pages import write_robot_pages

ROOT = Path(__file__).resolve().parents[2]
#: Files of the repository that are pages of the site, by the page.
OUTSIDE = {
    "description.png": "urdf/sst.png",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "description.md": "urdf/README.md",
}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
#: Code first, which holds no equations.
_CODE_OR_MATH = re.compile(
    r"^```.*?^```$|`[^`\n]+`|\$\$(?P<block>.+?)\$\$|(?<![\\$])\$(?P<inline>[^\s$](?:[^$]*[^\s$])?)\$",
    re.DOTALL | re.MULTILINE,
)


def pages() -> dict[str, Path]:
    """Where each page or picture of the site comes from, but for those of the robots."""
    docs = ROOT / "docs"
    found = {p.relative_to(docs).as_posix(): p for p in sorted(docs.rglob("*")) if p.is_file()}
    return found | {page: ROOT / source for page, source in OUTSIDE.items()}


def write_pages(folder: Path) -> None:
    """Write all pages to a folder, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    page_of = {path.relative_to(ROOT).as_posix(): page for page, path in pages().items()}
    for page, path in pages().items():
        (folder / page).parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            text = with_links(path.read_text(encoding="utf-8"), page, page_of)
            (folder / page).write_text(with_equations(text), encoding="utf-8")
        else:
            shutil.copyfile(path, folder / page)
    write_robot_pages(folder / "robots")


def with_links(text: str, page: str, page_of: dict[str, str]) -> str:
    """Point links between files of the repository at pages; of others the words remain.

    In a clone they lead to the files themselves.
    """
    here = posixpath.dirname(next(file for file, name in page_of.items() if name == page))

    def linked(found: re.Match[str]) -> str:
        image, text, target = found.groups()
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target) or not path:
            return found[0]
        path = posixpath.normpath(posixpath.join(here, path))
        if path in page_of:
            anchor = f"#{anchor}" if anchor else ""
            way = posixpath.relpath(page_of[path], posixpath.dirname(page) or ".")
            return f"{image}[{text}]({way}{anchor})"
        if not (ROOT / path).exists():
            return found[0]  # the builder says that it is missing
        return "" if image else text

    return _LINK.sub(linked, text)


def with_equations(text: str) -> str:
    """Typeset $...$ and $$...$$ as MathML."""

    def typeset(found: re.Match[str]) -> str:
        latex = found["block"] or found["inline"]
        if not latex:
            return found[0]
        number = ""
        if tagged := re.search(r"\\tag\{([^}]*)\}", latex):
            latex, number = latex.replace(tagged[0], ""), f"<span>({html.escape(tagged[1])})</span>"
        mathml = convert(latex.strip(), display="block" if found["block"] else "inline")
        # Markdown reads no emphasis, links or escapes in it.
        mathml = re.sub(r"[*_\[\]\\]", lambda sign: f"&#{ord(sign[0])};", mathml)
        return f'\n<div class="equation">{mathml}{number}</div>\n' if found["block"] else mathml

    return _CODE_OR_MATH.sub(typeset, text)


def main() -> None:
    """Write the pages where mkdocs.yml looks for them."""
    argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0]).parse_args()
    write_pages(ROOT / "site_pages")


if __name__ == "__main__":
    main()
