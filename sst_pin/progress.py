# SPDX-License-Identifier: BSD-2-Clause
"""Work that takes more than two seconds shows a progress bar or says what it does.

Bars appear on terminals and in notebooks only.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from functools import cache
from logging import getLogger
from time import monotonic, time
from typing import Any, TypeVar

T = TypeVar("T")
#: Nothing is shown before this time, [s].
PATIENCE = 2.0
_log = getLogger("sst_pin")


#: A hint for work that is slow on the reference path.
FASTER = "in Python, chain.compile() makes the dynamics several hundred times faster"


class Bar:
    """A progress bar of tqdm and a hint in the log. Both appear after `PATIENCE`."""

    def __init__(self, hint: str = "", **options: Any) -> None:
        self._bar: Any = None
        self._options = options
        self._hint = hint
        self._began = time()
        self._appears = monotonic() + PATIENCE

    def reach(self, done: float) -> None:
        """Show how much is done, in the unit of tqdm's option `total`, the amount of all work."""
        if self._bar is None and monotonic() > self._appears:
            from tqdm import tqdm  # its import takes longer than most calls

            say_once(self._hint)
            # The time that is left follows from the average speed since the beginning.
            self._bar = tqdm(leave=False, smoothing=0, disable=not _watched(), **self._options)
            self._bar.start_t = self._began
        if self._bar is not None:
            self._bar.update(max(done - self._bar.n, 0))

    def close(self) -> None:
        """Remove it."""
        if self._bar is not None:
            self._bar.close()


def counted(
    things: Iterable[T], what: str, total: int | None = None, hint: str = ""
) -> Iterator[T]:
    """Yield things one by one, with a bar called `what` and a hint if they take long."""
    with closing(Bar(hint, desc=what, total=total)) as bar:
        for done, thing in enumerate(things):
            if done:
                bar.reach(done)
            yield thing


def _watched() -> bool:
    """Whether a person watches the output: a bar in a log is thousands of lines."""
    if "ipykernel" in sys.modules:
        return True
    return sys.stderr is not None and sys.stderr.isatty()  # a daemon may have none


@contextmanager
def announced(text: str) -> Iterator[None]:
    """Log a text, once in a process, if what happens in the context takes long."""
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
