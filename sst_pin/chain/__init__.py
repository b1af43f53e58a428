# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain: closures, assembly, mobility, the orthogonal complement, dynamics."""

from importlib.util import find_spec
from pathlib import Path

from ..extensions import require_current

_kinds = find_spec(f"{__name__}.closure_kinds")
if _kinds is not None and _kinds.origin is not None and not _kinds.origin.endswith(".py"):
    _source = Path(__file__).with_name("closure_kinds.py")
    require_current(_kinds.origin, _source, _source.with_suffix(".pxd"))
