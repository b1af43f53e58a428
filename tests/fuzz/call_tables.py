# SPDX-License-Identifier: BSD-2-Clause
"""The groups of calls that `judged_calls` serves."""

from collections.abc import Iterator

import file_calls
import shown_calls
import signature_calls
import special_calls
from call_world import World
from judged_calls import Call

GROUPS = {
    "signatures": signature_calls.calls,
    "chains": special_calls.chains,
    "motions": special_calls.motions,
    "files": file_calls.calls,
    "pictures": shown_calls.pictures,
    "commands": shown_calls.commands,
}


def calls(group: str) -> Iterator[Call]:
    """The calls of one group."""
    return GROUPS[group](World())
