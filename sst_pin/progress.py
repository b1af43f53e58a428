# SPDX-License-Identifier: BSD-2-Clause
"""What takes more than two seconds shows a bar, or says what it does."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from logging import getLogger
from time import monotonic
from typing import Any, TypeVar

T = TypeVar("T")
#: Until then nothing is shown, [s].
PATIENCE = 2.0
_log = getLogger("sst_pin")


def counted(things: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Things one by one, with a bar once they take longer."""
    bar, end = None, monotonic() + PATIENCE
    try:
        for done, thing in enumerate(things):
            if bar is not None:
                bar.update()
            elif done and monotonic() > end:
                bar = _bar(desc=what, total=total, initial=done)
            yield thing
    finally:
        if bar is not None:
            bar.close()


@contextmanager
def over_time(
    what: str, start: float, end: float, hint: str = ""
) -> Iterator[Callable[[float], None]]:
    """A function of the time reached, which shows a bar, and a hint once in a process."""
    bar, late = None, monotonic() + PATIENCE
    form = "{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} s of motion"

    def reach(t: float) -> None:
        nonlocal bar
        if bar is None and monotonic() > late:
            say_once(hint)
            bar = _bar(desc=what, total=round(end - start, 9), unit="s", bar_format=form)
        if bar is not None:
            bar.update(max(t - start - bar.n, 0))

    try:
        yield reach
    finally:
        if bar is not None:
            bar.close()


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


def _bar(**how: Any) -> Any:
    from tqdm import tqdm  # its import takes longer than most calls

    return tqdm(**how, leave=False)
