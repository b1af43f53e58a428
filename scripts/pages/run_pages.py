# SPDX-License-Identifier: BSD-2-Clause
"""Run the code of pages as a reader would paste it, and write the output that they show.

`python scripts/pages/run_pages.py docs/quickstart.md ...` fills in the output blocks; with
`--paste FOLDER` it writes the files of one page, and its Python as `session.py`, to a folder.

A page is one session, from top to bottom, in an empty folder with `examples/` beside it:

- a block of a file (`title="five_bar.urdf"`) is written to it,
- Python runs, `sst-pin` lines of shell blocks run, other programs do not,
- a block with `title="output"` is what the block before prints,
- a block after `<!-- not run: reason -->` is passed over.
"""

import argparse
import contextlib
import io
import os
import re
import shlex
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
_FENCE = re.compile(
    r"(?P<not_run><!-- not run: .+? -->\n)?"
    r'^```(?P<language>\w*)(?: title="(?P<title>[^"]*)")?[^\n]*\n(?P<text>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
#: Shell lines that are left out: installation and tools that are not ours.
OTHERS = (
    *("pip", "python", "python3", "zensical", "git", "cd", "head", "ls", "cc"),
    *("check_urdf", "dask", "jupyter", "mypy", "pytest", "ruff"),
)


class Block(NamedTuple):
    """A fenced block."""

    language: str
    title: str | None
    text: str
    run: bool
    start: int  # of its text in the page
    end: int


def blocks(page: str) -> list[Block]:
    """The blocks of a page, in order."""
    return [
        Block(m["language"], m["title"], m["text"], not m["not_run"], *m.span("text"))
        for m in _FENCE.finditer(page)
    ]


def shell(text: str) -> Iterator[list[str]]:
    """The `sst-pin` commands of a shell block; a program neither ours nor known is refused."""
    for line in text.replace("\\\n", " ").splitlines():
        for command in re.split(r"&&|(?<!\|)\|(?!\|)", line):
            words = shlex.split(command, comments=True)
            program = words[0].rpartition("/")[2] if words else ""
            if program == "sst-pin":
                yield words[1:]
            elif words and program not in OTHERS:
                raise ValueError(f"{line!r}: {program!r} is not a program that pages run")


def run(page: str) -> Iterator[tuple[Block, str]]:
    """What each output block should hold, as the page is run in the current folder."""
    from sst_pin.cli import main

    session = {"__name__": "__main__"}
    printed = ""
    for block in blocks(page):
        if not block.run:
            continue
        if block.title == "output":
            yield block, printed
        elif block.title is not None:
            path = Path(block.title)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.language in ("python", "bash"):
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                if block.language == "python":
                    exec(compile(block.text, "<page>", "exec"), session)
                else:
                    for arguments in shell(block.text):
                        if code := main(arguments):
                            raise RuntimeError(f"sst-pin {shlex.join(arguments)}: {code}")
            printed = out.getvalue()


def with_outputs(page: str) -> str:
    """The page with its output blocks as they are printed now."""
    for block, printed in reversed(list(run(page))):
        page = page[: block.start] + printed.rstrip() + "\n" + page[block.end :]
    return page


def paste(page: str, folder: Path) -> None:
    """Write the files of a page and its Python to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    given = [block for block in blocks(page) if block.run]
    for block in given:
        if block.title not in (None, "output"):
            (folder / block.title).write_text(block.text, encoding="utf-8")
    session = "\n".join(b.text for b in given if b.language == "python" and b.title is None)
    (folder / "session.py").write_text(session, encoding="utf-8")


def main() -> None:
    """Fill in the outputs of pages, or paste one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", type=Path, nargs="+")
    parser.add_argument("--paste", type=Path, metavar="FOLDER")
    arguments = parser.parse_args()
    if arguments.paste:
        for path in arguments.pages:
            paste(path.read_text(encoding="utf-8"), arguments.paste)
        return
    for path in arguments.pages:
        page = path.read_text(encoding="utf-8")
        here = Path.cwd()
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "examples").symlink_to(ROOT / "examples")
            os.chdir(folder)
            try:
                filled = with_outputs(page)
            finally:
                os.chdir(here)
        path.write_text(filled, encoding="utf-8")


if __name__ == "__main__":
    main()
