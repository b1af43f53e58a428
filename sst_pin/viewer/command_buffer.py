# SPDX-License-Identifier: BSD-2-Clause
"""A window for Meshcat in this process, without a server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import umsgpack


class CommandBuffer:
    """A window for `meshcat.Visualizer` that keeps the last command for every node.

    Attributes:
        commands: Packed for the page, by type, node and property.
        listener: Function that receives each command.
    """

    def __init__(self) -> None:
        self.commands: dict[tuple[str, str, str], bytes] = {}
        self.listener: Callable[[bytes], None] | None = None

    def send(self, command: Any) -> None:
        """Receive a command of Meshcat."""
        lowered = command.lower()
        kind, path = lowered["type"], lowered.get("path", "")
        packed = umsgpack.packb(lowered)
        if kind == "delete":
            gone = [key for key in self.commands if f"{key[1]}/".startswith(f"{path}/")]
            for key in gone:
                del self.commands[key]
        else:
            key = (kind, path, lowered.get("property", ""))
            self.commands.pop(key, None)
            self.commands[key] = packed  # at the end: an animation follows the nodes it moves
        if self.listener is not None:
            self.listener(packed)
