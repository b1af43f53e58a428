# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain: closures, assembly, mobility, the orthogonal complement, dynamics."""

from importlib.util import find_spec
from pathlib import Path

from ..extensions import require_current

for _name in ("blocks", "calls", "closure_kinds"):
    _found = find_spec(f"{__name__}.{_name}")
    if _found is not None and _found.origin is not None and not _found.origin.endswith(".py"):
        _source = Path(__file__).with_name(f"{_name}.py")
        require_current(_found.origin, _source, _source.with_suffix(".pxd"))
