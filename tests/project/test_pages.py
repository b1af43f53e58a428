# SPDX-License-Identifier: BSD-2-Clause
"""Pages: all are reached, links lead somewhere, code runs and prints what they show."""

import inspect
import re
from pathlib import Path

import pytest

import sst_pin
from tests.support.files import ROOT, load
from tests.support.shown_output import same_output

robot_pages = load("scripts/pages/robot_pages.py")
make_site = load("scripts/pages/make_site.py")
run_pages = load("scripts/pages/run_pages.py")
blocks = run_pages.blocks
run = run_pages.run
shell = run_pages.shell

DOCS = ROOT / "docs"
#: Pages of the site that lie elsewhere or are written for it.
ELSEWHERE = {page for page in make_site.OUTSIDE if page.endswith(".md")}
ELSEWHERE |= {f"robots/{name}.md" for name in robot_pages.NAMES}
#: Pages whose code other tests run.
RUN_ELSEWHERE = {"urdf/README.md": "description/test_description_folder.py"}
#: These compile, draw, or run for seconds.
LONG = "assembly_modes batches cables command_line control derivatives export_c gpu "
LONG += "identification loader optimal_control own_robot plots pose_abilities simulate "
LONG += "standard_problems timing viewer"
SLOW = {"README.md"} | {f"docs/{name}.md" for name in LONG.split()}

PAGES = {path.relative_to(ROOT).as_posix(): path for path in sorted(DOCS.rglob("*.md"))}
PAGES |= {name: ROOT / name for name in ("README.md", "CONTRIBUTING.md", "urdf/README.md")}
WITH_CODE = [name for name, path in PAGES.items() if blocks(path.read_text(encoding="utf-8"))]
RUN_HERE = [name for name in WITH_CODE if name not in RUN_ELSEWHERE]


def pages_of(nav):
    """The pages that a navigation names, from zensical.toml."""
    for entry in nav:
        if isinstance(entry, str):
            yield entry
        else:
            for below in entry.values():
                yield from pages_of(below if isinstance(below, list) else [below])


def test_every_page_is_in_the_navigation():
    tomllib = pytest.importorskip("tomllib")  # since Python 3.11
    config = tomllib.loads((ROOT / "zensical.toml").read_text(encoding="utf-8"))["project"]
    there = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} | ELSEWHERE
    named = list(pages_of(config["nav"]))
    assert sorted(there - set(named)) == [], "add these pages to `nav` in zensical.toml"
    assert sorted(set(named) - there) == [], "these pages of `nav` in zensical.toml are not there"
    assert len(named) == len(set(named))


def test_links_lead_to_files_that_exist(monkeypatch):
    """Zensical checks pages and anchors when it builds the site, and no other files."""
    make_site.texts()
    monkeypatch.setitem(make_site.OUTSIDE, "wrong.md", "tests/project/wrong.md")
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: "![](nowhere.png)")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.png leads nowhere"):
        make_site.texts()


@pytest.mark.parametrize("name", PAGES)
def test_tables_are_whole(name):
    """After an empty line a row is a header; others would be shown as text."""
    text = re.sub(r"^```.*?^```$", "", PAGES[name].read_text(encoding="utf-8"), flags=re.S | re.M)
    starts = re.findall(r"^(?<!\|\n)\|.*\n(.*)", text, re.MULTILINE)
    assert [below for below in starts if not re.fullmatch(r"[|: -]+", below)] == []


@pytest.mark.filterwarnings("default::sst_pin.errors.SingularityWarning")
@pytest.mark.filterwarnings("default:.*largest velocities.*:sst_pin.errors.DescriptionWarning")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in RUN_HERE],
)
def test_code_of_the_page_runs_and_prints_what_it_shows(name, tmp_path, monkeypatch):
    """A page runs as one session in an empty folder; the last digit shown may differ."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    page = PAGES[name].read_text(encoding="utf-8")
    for block, printed in run(page):
        assert same_output(block.text, printed), (
            f"shown:\n{block.text}\nprinted:\n{printed}\n"
            f"python scripts/pages/run_pages.py {name} writes what is printed"
        )
        if name != "docs/reactions.md":  # there NaN is what is not unique
            assert "nan" not in printed


REFERENCE = {path.name: path.read_text(encoding="utf-8") for path in DOCS.glob("reference/*.md")}


def test_every_public_name_is_in_the_reference():
    text = "\n".join(REFERENCE.values())
    missing = []
    for name in sst_pin.__all__:
        thing = getattr(sst_pin, name)
        if inspect.ismodule(thing):
            shown = f"::: sst_pin.{name}\n" in text
            if not shown:  # its members one by one
                # An object of its own, or a constant in a table.
                entry = r"^(::: [\w.]+\.{0}$|\| `sst_pin\.[\w.]*{0}`)"
                shown = all(re.search(entry.format(m), text, re.M) for m in thing.__all__)
        elif callable(thing) and thing.__module__ == "sst_pin.errors":
            shown = "::: sst_pin.errors\n" in text
        elif callable(thing):
            shown = f"::: {thing.__module__}.{thing.__qualname__}\n" in text
        else:
            shown = f"`sst_pin.{name}`" in text
        missing += [] if shown else [name]
    assert not missing, f"docs/reference/*.md want an entry for {', '.join(missing)}"
    robots = [name for name in sst_pin.robots.__all__ if name.islower() or name == "GalleryRobot"]
    assert [name for name in robots if f"- {name}\n" not in REFERENCE["robots.md"]] == []
