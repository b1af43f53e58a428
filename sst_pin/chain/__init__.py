# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain: closures, assembly, mobility, the orthogonal complement, dynamics."""

from ..extensions import require_current_modules

require_current_modules(__name__, ("blocks", "calls", "closure_kinds"))
