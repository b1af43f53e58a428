# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin`."""

import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments; by default the arguments of the process.

    Returns:
        The exit code: 0 for success; 1 if referees disagree, a description has errors or `--strict`
        refuses a motion; 2 for an error, which is printed in one line; 3 if a simulation ends
        early; 128 plus the number of the signal that ended the command.
    """
    try:
        try:
            _replace_closed_streams()
            with _sigterm_unwinds():
                # The import is slow. It is inside `try`, so that Ctrl-C ends it without a
                # traceback.
                from .commands import run

                return run(argv)
        finally:
            sys.stdout.flush()  # here, so that the errors of a closed pipe are caught below
    except KeyboardInterrupt:
        return _end(128 + signal.SIGINT, "interrupted")
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
        return _end(128 + signal.SIGPIPE)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _end(2, f"error: {where}{error.strerror or error}")


@contextmanager
def _sigterm_unwinds() -> Iterator[None]:
    """In this block SIGTERM raises SystemExit, so that temporary files are deleted."""
    if threading.current_thread() is not threading.main_thread():  # Python allows no handler there
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class ClosedStream(io.TextIOBase):
    """Standard input or output that the caller has closed: reading and writing raise an error."""

    #: Name in error messages about the file that is read.
    name = "standard input"

    @property
    def buffer(self) -> "ClosedStream":
        """The stream of bytes."""
        return self

    def write(self, text: object) -> int:
        """Raise the error of a closed stream."""
        raise OSError(errno.EBADF, os.strerror(errno.EBADF), "standard output")

    def read(self, size: int | None = -1) -> str:
        """Raise the error of a closed stream."""
        raise OSError(errno.EBADF, os.strerror(errno.EBADF), "standard input")


class UnreadStream(io.TextIOBase):
    """Standard error that the caller has closed: what is written is dropped."""

    def write(self, text: str) -> int:
        """Drop a text."""
        return len(text)


def _replace_closed_streams() -> None:
    """Replace standard streams that the caller has closed.

    Python has None in their place, and `print` to None would write to standard output.
    """
    if sys.stdin is None:
        sys.stdin = ClosedStream()
    if sys.stdout is None:
        sys.stdout = ClosedStream()
    if sys.stderr is None:
        sys.stderr = UnreadStream()


def _end(code: int, message: str = "") -> int:
    """Print a last message; returns the exit code.

    At its end, the interpreter flushes standard output, which may be a closed pipe. So it is
    redirected to nowhere.
    """
    with suppress(OSError):
        if message:
            print(f"sst-pin: {message}", file=sys.stderr)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
    return code
