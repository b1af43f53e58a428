# SPDX-License-Identifier: BSD-2-Clause
"""The notebooks run from top to bottom."""

import pytest

from tests.support.files import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
PAGE = ROOT / "docs" / "quickstart.md"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, tmp_path, monkeypatch):
    """In an empty folder, without an error, with the same kinds of output as are stored in it."""
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed (extra 'dev')")
    nbformat = pytest.importorskip("nbformat")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    shown = [kinds(cell) for cell in notebook.cells]
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    assert [kinds(cell) for cell in notebook.cells] == shown


def kinds(cell):
    """The text of its outputs, without the messages of the kernel."""
    return [
        (output["output_type"], sorted(output.get("data", ())))
        for output in cell.get("outputs", ())
        if output.get("name") != "stderr"
    ]


def test_the_page_names_every_notebook():
    assert NOTEBOOKS
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"`{path.name}`" in page for path in NOTEBOOKS)
