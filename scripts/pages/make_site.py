# SPDX-License-Identifier: BSD-2-Clause
"""Build the documentation site in `site/`.

The pages are those of docs/, some from the root of the repository, and one for each robot of the
gallery. They are written to `site_pages/`: equations become MathML, so that a browser needs no
script for them; links that leave the pages lose their target. Zensical builds the site from there.
Every page is on the site as plain Markdown too, and `llms.txt` lists them.
"""

import argparse
import html
import inspect
import posixpath
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
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
#: Code first, which holds no links and no equations.
_CODE_OR_LINK = re.compile(
    r"^```.*?^```$|(?P<image>!?)\[(?P<words>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^()\s]+)\)",
    re.DOTALL | re.MULTILINE,
)
_CODE_OR_MATH = re.compile(
    r"^```.*?^```$|`[^`\n]+`|\$\$(?P<block>.+?)\$\$|(?<![\\$])\$(?P<inline>[^\s$](?:[^$]*[^\s$])?)\$",
    re.DOTALL | re.MULTILINE,
)
#: An object of the reference, with its options.
_OBJECT = re.compile(r"^::: ([\w.]+)\n(?: {4}.*\n)*", re.MULTILINE)
#: The picture of the first page, and what the site shows in its place.
_PICTURE = re.compile(r"!\[[^\]]*\]\(motion\.gif\)")
_LIVE_SST = '<iframe src="robots/sst_live.html" title="the SST, live" class="live"></iframe>'
_LEAD = re.compile(r"^# (?P<title>[^\n]+)\n+(?P<sentence>(?:[A-Z].*?[.?](?=\s))?)", re.DOTALL)


def pages() -> dict[str, Path]:
    """The file of each page or picture of the site, without the pages of the robots."""
    docs = ROOT / "docs"
    files = {p.relative_to(docs).as_posix(): p for p in sorted(docs.rglob("*")) if p.is_file()}
    return files | {page: ROOT / source for page, source in OUTSIDE.items()}


def texts() -> dict[str, str]:
    """The Markdown of each page, without those of the robots; its links are those of the site.

    Raises:
        FileNotFoundError: A link leads to a file that does not exist.
    """
    page_of = {path.relative_to(ROOT).as_posix(): page for page, path in pages().items()}
    return {
        page: _with_links(path.read_text(encoding="utf-8"), page, page_of)
        for page, path in pages().items()
        if path.suffix == ".md"
    }


def write_pages(folder: Path) -> None:
    """Write all pages to a folder, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    text = texts()
    for page, path in pages().items():
        (folder / page).parent.mkdir(parents=True, exist_ok=True)
        if page in text:
            content = _with_equations(text[page])
            if page == "index.md":
                content = _PICTURE.sub(_LIVE_SST, content)
            (folder / page).write_text(content, encoding="utf-8")
        else:
            shutil.copyfile(path, folder / page)
    write_robot_pages(folder / "robots")


def build(folder: Path) -> None:
    """Build `site/` from the pages of a folder; a warning of Zensical is an error."""
    print("pages", flush=True)
    write_pages(folder / "site_pages")
    print("site", flush=True)
    shutil.rmtree(folder / "site", ignore_errors=True)
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    subprocess.run(command, cwd=folder, check=True)
    print("Markdown", flush=True)
    _write_markdown(folder)


def _with_links(text: str, page: str, page_of: dict[str, str]) -> str:
    """Lead links between files of the repository to pages; of others the words remain."""
    here = posixpath.dirname(next(file for file, name in page_of.items() if name == page))

    def linked(link: re.Match[str]) -> str:
        path, _, anchor = (link["target"] or "").partition("#")
        if not path or re.match(r"[a-z]+:", path):
            return link[0]
        path = posixpath.normpath(posixpath.join(here, path))
        if path in page_of:
            anchor = f"#{anchor}" if anchor else ""
            way = posixpath.relpath(page_of[path], posixpath.dirname(page) or ".")
            return f"{link['image']}[{link['words']}]({way}{anchor})"
        if not (ROOT / path).exists():
            raise FileNotFoundError(f"{page}: the link {link['target']} leads nowhere")
        return "" if link["image"] else link["words"]

    return _CODE_OR_LINK.sub(linked, text)


def _with_equations(text: str) -> str:
    """Typeset $...$ and $$...$$ as MathML."""

    def typeset(found: re.Match[str]) -> str:
        latex = found["block"] or found["inline"]
        if not latex:
            return found[0]
        number = ""
        if tagged := re.search(r"\\tag\{([^}]*)\}", latex):
            latex = latex.replace(tagged[0], "")
            number = f"<span>({html.escape(tagged[1])})</span>"
        mathml = convert(latex.strip(), display="block" if found["block"] else "inline")
        # Markdown reads no emphasis, links or escapes in it.
        mathml = re.sub(r"[*_\[\]\\]", lambda sign: f"&#{ord(sign[0])};", mathml)
        return f'\n<div class="equation">{mathml}{number}</div>\n' if found["block"] else mathml

    return _CODE_OR_MATH.sub(typeset, text)


def _write_markdown(folder: Path) -> None:
    """Write each page as plain Markdown beside its HTML, and `llms.txt`, which lists them."""
    sources = texts() | {
        f"robots/{path.name}": path.read_text(encoding="utf-8")
        for path in sorted((folder / "site_pages" / "robots").glob("*.md"))
    }
    lines = ["# sst_pin", "", "> Dynamics of closed-chain robots on Pinocchio.", ""]
    for page, text in sources.items():
        (folder / "site" / page).write_text(_OBJECT.sub(_described, text), encoding="utf-8")
        lead = _LEAD.search(text)
        sentence = " ".join(lead["sentence"].split())
        line = f"- [{lead['title']}]({page})"
        lines.append(f"{line}: {sentence}" if sentence else line)
    (folder / "site" / "llms.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _described(found: re.Match[str]) -> str:
    """The signatures and docstrings of an object of the reference and of its members."""
    module, _, name = found[1].rpartition(".")
    return "\n".join(_help(name, getattr(import_module(module), name)))


def _help(name: str, thing: object) -> Iterator[str]:
    try:
        signature = str(inspect.signature(thing))
    except (TypeError, ValueError):  # a module, a property
        signature = ""
    yield f"## `{name}{signature}`\n\n{inspect.getdoc(thing) or ''}\n"
    if inspect.isclass(thing) or inspect.ismodule(thing):
        for member in getattr(thing, "__all__", dir(thing)):
            value = getattr(thing, member, None)
            ours = str(getattr(value, "__module__", "")).startswith("sst_pin")
            if not member.startswith("_") and (ours or isinstance(value, property)):
                yield from _help(f"{name}.{member}", value)


def main() -> None:
    """Build the site."""
    argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0]).parse_args()
    build(ROOT)
    print("python -m http.server -d site: http://localhost:8000; from the disk, without search")


if __name__ == "__main__":
    main()
