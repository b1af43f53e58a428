# SPDX-License-Identifier: BSD-2-Clause
"""The former place of `sst_pin.sst.workspace`, kept for one release."""

from .sst.workspace import Workspace, workspace_at, workspace_over_rolls

__all__ = ["Workspace", "workspace_at", "workspace_over_rolls"]
