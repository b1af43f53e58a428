# SPDX-License-Identifier: BSD-2-Clause
"""Work that takes more than two seconds shows a progress bar or says what it does."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from functools import cache
from logging import getLogger
from time import monotonic
from typing import Any, TypeVar

T = TypeVar("T")
#: Until then nothing is shown, [s].
PATIENCE = 2.0
_log = getLogger("sst_pin")


class Bar:
    """A bar of tqdm with a hint; it appears only after some seconds."""

    def __init__(self, hint: str = "", **how: Any) -> None:
        self._bar: Any = None
        self._how, self._hint, self._late = how, hint, monotonic() + PATIENCE

    def reach(self, done: float) -> None:
        """Show how much is done."""
        if self._bar is None and monotonic() > self._late:
            from tqdm import tqdm  # its import takes longer than most calls

            say_once(self._hint)
            self._bar = tqdm(leave=False, **self._how)
        if self._bar is not None:
            self._bar.update(max(done - self._bar.n, 0))

    def close(self) -> None:
        """Remove it."""
        if self._bar is not None:
            self._bar.close()


def counted(things: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Things one by one, with a bar once they take longer."""
    with closing(Bar(desc=what, total=total)) as bar:
        for done, thing in enumerate(things):
            if done:
                bar.reach(done)
            yield thing


@contextmanager
def announced(text: str) -> Iterator[None]:
    """Say once in a process what takes longer."""
    timer = threading.Timer(PATIENCE, say_once, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@cache
def say_once(text: str) -> None:
    """Log a line once in a process."""
    if text:
        _log.warning("sst-pin: %s", text)
