# SPDX-License-Identifier: BSD-2-Clause
"""The content of files that describe a robot."""

from __future__ import annotations

from pathlib import Path

from ..errors import DescriptionError


def read_text(path: str | Path, what: str) -> str:
    """The content of a description file.

    Raises:
        DescriptionError: When it cannot be read.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DescriptionError(str(path), [f"the {what} cannot be read: {error}"]) from None
