# SPDX-License-Identifier: BSD-2-Clause
"""The groups of calls that `judged_calls` serves."""

from collections.abc import Iterator

import array_calls
import chain_calls
import file_calls
import motion_calls
import shown_calls
from call_world import World
from judged_calls import Call

GROUPS = {
    "arrays": array_calls.calls,
    "chains": chain_calls.calls,
    "motion": motion_calls.calls,
    "files": file_calls.calls,
    "pictures": shown_calls.pictures,
    "commands": shown_calls.commands,
}


def calls(group: str) -> Iterator[Call]:
    """The calls of one group."""
    return GROUPS[group](World())
