# SPDX-License-Identifier: BSD-2-Clause
"""The documentation site: builds without a warning, holds every name, asks no other host."""

import inspect
import json
import re
import shutil
from html.parser import HTMLParser

import pytest

import sst_pin
from sst_pin.former_names import FormerName
from tests.support.browser import needs_browser, visit
from tests.support.files import ROOT, load

make_site = load("scripts/pages/make_site.py")

pytestmark = pytest.mark.slow


#: Nobody listens: neither the build nor a page may need another host.
NOBODY = "http://127.0.0.1:9"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built without a warning."""
    pytest.importorskip("zensical", reason="zensical is not installed (extra 'docs')")
    folder = tmp_path_factory.mktemp("project")
    shutil.copyfile(ROOT / "zensical.toml", folder / "zensical.toml")  # a link would be followed
    for name in ("sst_pin", "scripts"):
        (folder / name).symlink_to(ROOT / name)
    with pytest.MonkeyPatch.context() as patch:
        for proxy in ("http_proxy", "https_proxy"):
            patch.setenv(proxy, NOBODY)
        patch.delenv("no_proxy", raising=False)
        make_site.build(folder)
    return folder / "site"


class Resources(HTMLParser):
    """What a browser loads with a page, and its ids."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        result = dict(attrs)
        self.ids.add(result.get("id"))
        if tag in ("script", "img", "iframe", "source", "video"):
            self.loaded.append(result.get("src"))
        if tag == "link" and result.get("rel") != "canonical":
            self.loaded.append(result.get("href"))


def test_pages_load_nothing_from_other_hosts(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 35
    for page in pages:
        loaded = filter(None, Resources(page.read_text(encoding="utf-8")).loaded)
        assert [link for link in loaded if re.match(r"(\w+:)?//", link)] == [], page
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\([\"']?(\w+:)?//|@import", sheet.read_text(encoding="utf-8"))


def test_the_reference_holds_every_method_inherited_ones_too(site):
    for page, owner in (("closed_chain", "ClosedChain"), ("sst", "SST")):
        ids = Resources((site / "reference" / f"{page}.html").read_text(encoding="utf-8")).ids
        names = {name.rpartition(".")[2] for name in filter(None, ids) if f"{owner}." in name}
        kind = getattr(sst_pin, owner)
        # Former names lead to others, which are there.
        former = {x for x in dir(kind) if isinstance(inspect.getattr_static(kind, x), FormerName)}
        names_now = set(dir(kind)) - former
        public = {x for x in names_now if not x.startswith("_") and hasattr(kind, x)}
        assert public - names == set(), f"{owner} on reference/{page}.html"


def test_equations_are_typeset_and_search_finds_words(site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math") > 30
    assert "$" not in re.sub("<script.*?</script>", "", theory, flags=re.DOTALL)
    assert "\\tag" not in theory
    index = json.loads((site / "search.json").read_text(encoding="utf-8"))
    text = " ".join(entry["text"] for entry in index["items"])
    assert "reduced_terms" in text
    assert "redundant" in text


def test_every_page_is_there_as_markdown_and_in_the_list_for_language_models(site):
    pages = {path.relative_to(site).as_posix() for path in site.rglob("*.md")}
    html = {path.relative_to(site).with_suffix(".md").as_posix() for path in site.rglob("*.html")}
    assert pages == {page for page in html if not page.endswith("_live.md")} - {"404.md"}
    listed = re.findall(r"^- \[.+?\]\((.+?)\)", (site / "llms.txt").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(pages)
    theory = (site / "theory.md").read_text(encoding="utf-8")
    assert r"\Phi\,L = 0" in theory
    methods = (site / "reference" / "closed_chain.md").read_text(encoding="utf-8")
    assert "## `ClosedChain.compute_torques(" in methods


@needs_browser
def test_a_page_of_a_robot_is_alive(site, chromium):
    with visit(chromium, (site / "robots" / "four_bar.html").as_uri()) as visited:
        visited.page.locator("iframe.live").scroll_into_view_if_needed()
        (live,) = visited.page.frames[1:]
        live.wait_for_function("typeof live === 'object'")
        assert len(live.evaluate("Array.from(live.robot.q)")) == 3
        assert visited.requests_elsewhere(site.as_uri()) == []
