# SPDX-License-Identifier: BSD-2-Clause
"""Files of the repository beside the package."""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]


def load(path: str) -> ModuleType:
    """Import a file of `examples/` or `scripts/`, its folder on the path as for `python FILE`."""
    file = ROOT / path
    sys.path.insert(0, str(file.parent))
    try:
        return import_module(file.stem)
    finally:
        sys.path.remove(str(file.parent))


def file_of_page(page: str, title: str) -> str:
    """The content of a file that a page of `docs/` shows."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(rf'title="{title}"\n(.*?)```', text, re.DOTALL)[0]
