# SPDX-License-Identifier: BSD-2-Clause
"""Calls that are judged in a process of their own: what they raise, return, or never end with."""

import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import sst_pin

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
    read, write = os.pipe()
    here = Path(__file__).parent
    call = f"serve({table!r}, {group!r}, {every}, {len(verdicts)}, {write})"
    code = f"import judged_calls; judged_calls.{call}"
    path = os.pathsep.join([str(here), str(here.parent), *filter(None, sys.path)])
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as noise:
        child = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", code],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "agg", "OMP_NUM_THREADS": "1"},
            pass_fds=[write],
            stdin=subprocess.DEVNULL,
            stdout=noise,
            stderr=noise,
        )
        os.close(write)
        running, ended = "the start of the group", False
        patience = 60.0  # until the package is imported
        for line in _lines(read, lambda: patience):
            name, kind, detail = json.loads(line)
            running, patience = name, 2 * LIMIT
            ended = kind == "end"
            if kind not in ("begin", "end"):
                verdicts.append(Verdict(name, kind, detail))
        os.close(read)
        if ended:
            child.wait()
            return True
        alive = child.poll() is None
        child.kill()
        code_left = child.wait()
        noise.seek(0)
        said = noise.read().decode(errors="replace").strip()[-300:]
    if running == "the start of the group" or (verdicts[-1:] and verdicts[-1].name == running):
        raise RuntimeError(f"{group} cannot go on after {running}: {said}")
    kind, how = ("endless", "not to be interrupted") if alive else ("raw", f"aborts: {code_left}")
    verdicts.append(Verdict(running, kind, f"{how}: {said}"))
    return False


def _lines(descriptor: int, patience: Callable[[], float]) -> Iterator[bytes]:
    """Lines of a pipe until it is closed, or until nothing comes for too long."""
    rest = b""
    while select.select([descriptor], [], [], patience())[0]:
        chunk = os.read(descriptor, 65536)
        if not chunk:
            time.sleep(0.05)  # the child is about to end
            return
        *whole, rest = (rest + chunk).split(b"\n")
        yield from whole


def serve(table: str, group: str, every: int, first: int, descriptor: int) -> None:
    """In the child: judge each n-th call from a first on, and write what becomes of them."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))

    def tell(*words: str) -> None:
        os.write(descriptor, (json.dumps(words) + "\n").encode())

    for call in list(__import__(table).calls(group))[::every][first:]:
        tell(call.name, "begin", "")
        tell(*call.judged())
    tell("", "end", "")
