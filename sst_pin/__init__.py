# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement.

`__init__.pyi` lists the public names; each is imported at its first use.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, _names = attach_stub(__name__, __file__)
#: What `from sst_pin import *` takes: all but the rooms that need an extra.
__all__ = sorted({*_names} - {"__version__", "plots", "viewer"})  # noqa: PLE0605
