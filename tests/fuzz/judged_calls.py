# SPDX-License-Identifier: BSD-2-Clause
"""Calls that are judged in a process of their own: what they raise, return, or never end with."""

import faulthandler
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import sst_pin
from tests.support.files import ROOT

#: [s]; what takes longer counts as endless.
LIMIT = 10.0
#: [bytes] of a child; what takes more fails instead of filling the machine.
MEMORY = 6 << 30
GOOD = ("named", "right")
FAULTS = ("raw", "silent", "endless")


class Endless(BaseException):
    """A call has not ended; no `except Exception` holds it."""


@contextmanager
def limited(seconds: float = LIMIT) -> Iterator[None]:
    """Raise `Endless` when the block takes longer; in the main thread only."""

    def stop(*_):
        raise Endless

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class Verdict(NamedTuple):
    """What became of a call: one of `GOOD` or `FAULTS`, and what it raised or returned."""

    name: str
    kind: str
    detail: str


@dataclass(frozen=True)
class Call:
    """A bad or odd call."""

    name: str
    run: Callable[[], Any]
    right: Callable[[Any], bool] | None = None

    def judged(self) -> Verdict:
        """Make the call."""
        try:
            with limited():
                value = self.run()
                good = self.right is not None and bool(self.right(value))
        except sst_pin.SSTError as error:
            return Verdict(self.name, "named", f"{type(error).__name__}: {error}"[:300])
        except Endless:
            return Verdict(self.name, "endless", f"more than {LIMIT:g} s")
        except BaseException as error:
            return Verdict(self.name, "raw", f"{type(error).__name__}: {error}"[:300])
        return Verdict(self.name, "right" if good else "silent", repr(value)[:200])


def judged_apart(table: str, group: str, every: int = 1) -> list[Verdict]:
    """Judge a group of calls in a child process; when a call ends the child, a new one goes on."""
    verdicts: list[Verdict] = []
    while not _child(table, group, every, verdicts):
        pass
    return verdicts


def report(verdicts: Iterable[Verdict]) -> str:
    """How many calls came to what, and every fault in a line."""
    verdicts = list(verdicts)
    kinds = [verdict.kind for verdict in verdicts]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in (*GOOD, *FAULTS))
    faults = [
        f"{v.kind}: {v.name}: {' '.join(v.detail.split())[:160]}"
        for v in verdicts
        if v.kind in FAULTS
    ]
    return "\n".join([f"{len(verdicts)} calls: {counts}", *faults])


def _child(table: str, group: str, every: int, verdicts: list[Verdict]) -> bool:
    """Whether a child came to the end of the group; what it found is added to the verdicts."""
    path = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
    with tempfile.TemporaryDirectory() as folder, tempfile.NamedTemporaryFile() as told:
        code = "from tests.fuzz.judged_calls import serve\n"
        code += f"serve({table!r}, {group!r}, {every}, {len(verdicts)}, {told.name!r})"
        child = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "agg", "OMP_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        lines = [Verdict(*json.loads(line)) for line in told.read().splitlines()]
    verdicts += [verdict for verdict in lines if verdict.kind not in ("begin", "end")]
    if lines and lines[-1].kind == "end":
        return True
    said = child.stdout.decode(errors="replace").strip()
    if not lines or lines[-1].kind != "begin":
        where = lines[-1].name if lines else "the start of the group"
        raise RuntimeError(f"{group} cannot go on after {where}: {said[-300:]}")
    over = "Timeout (" in said  # in the words of faulthandler
    kind, how = ("endless", "not to be interrupted") if over else ("raw", "aborts")
    verdicts.append(Verdict(lines[-1].name, kind, f"{how}: {child.returncode}: {said[-300:]}"))
    return False


def serve(table: str, group: str, every: int, first: int, told: str) -> None:
    """In the child: judge each n-th call from a first on, and write what becomes of them."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    faulthandler.dump_traceback_later(60, exit=True)  # until the calls are made
    calls = list(import_module(table).calls(group))[::every][first:]
    with Path(told).open("a", encoding="utf-8", buffering=1) as file:

        def tell(*words: str) -> None:
            file.write(json.dumps(words) + "\n")

        for call in calls:
            faulthandler.dump_traceback_later(2 * LIMIT, exit=True)
            tell(call.name, "begin", "")
            tell(*call.judged())
        tell("", "end", "")
