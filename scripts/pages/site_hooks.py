# SPDX-License-Identifier: BSD-2-Clause
"""What mkdocs.yml adds to MkDocs: pages from the root, links that lead out of docs/, equations."""

import html
import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
#: Files of the repository that are pages of the site, by the page.
PAGES = {
    "description.png": "urdf/sst.png",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "description.md": "urdf/README.md",
}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
_MATH = re.compile(r'<(span|div) class="arithmatex">\\([\[(])(.*?)\\[\])]</\1>', re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that lie outside docs/, and the pictures beside them."""
    for page, source in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point links between files of the repository at pages; of others the words remain.

    In a clone they lead to the files themselves.
    """
    source = PAGES.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    page_of = {path: name for name, path in PAGES.items()}

    def linked(found: re.Match[str]) -> str:
        image, text, target = found.groups()
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target) or not path:
            return found[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if not (ROOT / path).exists() and path not in page_of:
            return found[0]  # MkDocs says that it is missing
        name = page_of.get(path) or (path.removeprefix("docs/") if path[:5] == "docs/" else "")
        if name and files.get_file_from_path(name):
            here = posixpath.dirname(page.file.src_uri) or "."
            anchor = f"#{anchor}" if anchor else ""
            return f"{image}[{text}]({posixpath.relpath(name, here)}{anchor})"
        return "" if image else text

    return _LINK.sub(linked, markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Typeset equations as MathML, so that a reader's browser loads no script for them."""

    def typeset(found: re.Match[str]) -> str:
        tag, bracket, latex = found.groups()
        latex, number = html.unescape(latex).strip(), ""
        if tagged := re.search(r"\\tag\{([^}]*)\}", latex):
            latex, number = latex.replace(tagged[0], ""), f"<span>({tagged[1]})</span>"
        display = "block" if bracket == "[" else "inline"
        mathml = convert(latex, display=display)
        return f'<div class="equation">{mathml}{number}</div>' if tag == "div" else mathml

    return _MATH.sub(typeset, content)
