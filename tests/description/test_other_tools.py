# SPDX-License-Identifier: BSD-2-Clause
"""Other people's tools load the description as docs/evidence.md says."""

import re

import pytest

from tests.support.files import ROOT

PAGE = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
CODE = dict(re.findall(r"^### (.+?)\n\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("tool", CODE)
def test_code_of_the_page_runs(tool, monkeypatch):
    """In the root of a clone."""
    for module in re.findall(r"^(?:import|from) (\w+)", CODE[tool], re.MULTILINE):
        pytest.importorskip(module, reason=f"{module} is missing (extra 'tools')")
    monkeypatch.chdir(ROOT)
    exec(CODE[tool], {})
