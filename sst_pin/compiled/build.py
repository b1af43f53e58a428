# SPDX-License-Identifier: BSD-2-Clause
"""From C to loaded libraries: a compiler, and a folder that keeps what it made.

A library is found again by the content that it was made from. Its file's name ends in the hash of
the file itself; the folder is the user's own, so that what is loaded is what was written. When a
new library makes the folder larger than `LARGEST`, those that were loaded longest ago are deleted.
A process loads a library once and keeps it in memory, so any process may delete any file.
"""

import ctypes
import hashlib
import logging
import os
import shutil
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import CompilationError

_AVX512 = ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mfma")
_AVX2 = ("-mavx2", "-mfma")
#: Samples at once, and what a compiler is told, for each instruction set.
TARGETS = {
    "avx512": (8, (*_AVX512, "-mprefer-vector-width=512")),
    "avx2": (4, _AVX2),
    "plain": (2, ()),
    "avx2_one": (1, _AVX2),
    "plain_one": (1, ()),
    "scalar": (1, ("-O1",)),  # C by CasADi; more takes twice as long and makes it no faster
}
#: The target for single samples of each: one number takes less time than a vector of equal ones.
ONE = {"avx512": "avx2_one", "avx2": "avx2_one", "plain": "plain_one"}
_OPTIONS = ("-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
#: Options for derivatives: with -O3 their long functions compile slower and run no faster.
LONG = ("-O1", "-fexpensive-optimizations")
_SUFFIX = ".so"
#: Bytes that all libraries in the cache have together, at most.
LARGEST = 2**30
#: All files of the package that decide what is in a kernel.
_CODE = (
    *("model/*.py", "loops/*.py", "dynamics/*.py"),
    *("compiled/*.py", "compiled/c/**/*.[ch]", "version.py"),
)
#: Seconds after which a person is told that a call compiles.
_PATIENCE = 1.0
#: The list of sizes in a library ends with -1; there are no more than this.
_MOST_SIZES = 8
_log = logging.getLogger(__name__)
_CURE = "set XDG_CACHE_HOME to another folder"
#: Folders in the cache where libraries are being made; older ones were left by a process that died.
_BUILDING, _DEAD = ".building-", 86_400.0  # seconds


#: The libraries that this process has loaded, by the cache and by what they were made from.
_loaded: dict[tuple[Path, str], ctypes.CDLL] = {}


@dataclass(frozen=True)
class Code:
    """A kernel in a loaded library; the names of its functions end in `entry`."""

    library: ctypes.CDLL
    entry: str

    def sizes(self, word: str) -> list[int]:
        """Sizes of the parameters, of the output of one of its functions, and of each input."""
        name = f"sizes_{word}_{self.entry}"
        numbers = list((ctypes.c_int * _MOST_SIZES).in_dll(self.library, name))
        return numbers[: numbers.index(-1)]

    def address(self, word: str) -> int:
        """Address of one of its functions: "run", of rollouts "rate" too."""
        function = getattr(self.library, f"{word}_{self.entry}")
        address = ctypes.cast(function, ctypes.c_void_p).value
        assert address is not None
        return address

    def prepared(self, numbers: Array) -> Array:
        """Parameters with the constants behind them that the kernel makes of them."""
        p = np.concatenate([numbers, np.zeros(self.sizes("run")[0] - len(numbers))])
        getattr(self.library, f"prepare_{self.entry}")(ctypes.c_void_p(p.ctypes.data))
        return p


class Clock:
    """Measures how long one call compiles, on all its threads; tells once that a person waits."""

    def __init__(self, robot: str) -> None:
        self._robot, self._lock = robot, threading.Lock()
        self._running, self._left = 0, _PATIENCE

    @contextmanager
    def running(self) -> Iterator[None]:
        """While something of the call compiles."""
        with self._lock:
            self._running += 1
            if self._running == 1 and self._left > 0:
                message = "sst-pin: compiling kernels of %s; the cache keeps them"
                self._started = time.monotonic()
                self._timer = threading.Timer(self._left, _log.warning, (message, self._robot))
                self._timer.start()
        try:
            yield
        finally:
            with self._lock:
                self._running -= 1
                if not self._running:
                    self._timer.cancel()
                    self._left -= time.monotonic() - self._started


class Entry(NamedTuple):
    """A library in the cache; `used` is when it was last loaded, in seconds since 1970."""

    path: Path
    robot: str
    kernel: str
    size: int
    used: float


def compiler() -> list[str]:
    """The command of a C compiler: `$CC`, the system's, or the one of the package ziglang."""
    if named := os.environ.get("CC", "").split():
        if not shutil.which(named[0]):
            raise CompilationError(f"CC names {named[0]}, which is not found; correct or unset CC")
        return named
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise CompilationError(
        "no C compiler found; install one (on Debian: apt install gcc), or: "
        "pip install 'sst-pin[compiler]'"
    )


def cache_folder() -> Path:
    """The user's cache folder; one that others can write to is refused."""
    folder = _folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        raise _unusable(folder, error) from None
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise CompilationError(
            f"{folder} is not safe: it must belong to you, and only you may write to it "
            f"(chmod 700 {folder})"
        )
    return folder


def _folder() -> Path:
    """The folder of libraries in the user's folder for caches."""
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():  # then it does not count, says XDG
        try:
            home = Path.home()
        except RuntimeError as error:
            raise CompilationError(f"no place for a cache: {error}; {_CURE}") from None
        base = home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache"
    return base / "sst_pin" / "kernels"


def _unusable(folder: Path, error: OSError) -> CompilationError:
    return CompilationError(f"{folder} cannot be used: {error.strerror or error}; {_CURE}")


def cached() -> list[Entry]:
    """All libraries in the cache, the last used first."""
    entries = []
    for path in cache_folder().glob(f"*.*.*.*{_SUFFIX}"):
        robot, kernel, *_ = path.name.rsplit(".", 4)
        with suppress(FileNotFoundError):  # another process empties it
            status = path.stat()
            entries.append(Entry(path, robot, kernel, status.st_size, status.st_mtime))
    return sorted(entries, key=lambda entry: -entry.used)


def empty_cache(largest: int = 0) -> int:
    """Delete the libraries last used longest ago until the rest is smaller than this; how many.

    Those in use stay in memory. What killed processes were compiling is deleted after a day.
    """
    left, old = 0, []
    for entry in cached():
        left += entry.size
        if left >= largest:
            old.append(entry.path)
    for path in old:
        try:
            path.unlink(missing_ok=True)  # another process may have deleted it
        except OSError as error:
            raise _unusable(path.parent, error) from None
    for folder in cache_folder().glob(f"{_BUILDING}*"):
        with suppress(FileNotFoundError):
            if folder.stat().st_mtime < time.time() - _DEAD:
                shutil.rmtree(folder, ignore_errors=True)
    return len(old)


def library(
    robot: str,
    kernel: str,
    content: bytes,
    target: str,
    source: Callable[[], str],
    options: tuple[str, ...] = (),
    clock: Clock | None = None,
) -> ctypes.CDLL:
    """The library of a kernel, of this process, from the cache, or compiled now.

    `content` is all that the source is made from, `target` one of `TARGETS`. More options of the
    compiler are the same for each kernel of this name. The clock is that of the call.
    """
    robot, parts = robot or "robot", [content, kernel.encode(), target.encode(), _version()]
    key = hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]
    place = _folder(), key
    if place not in _loaded:
        folder = cache_folder()
        try:
            found = _found(folder, key)
            if found is None:
                _log.info("compiling %s of %s for %s; the cache keeps it", kernel, robot, target)
                label = f"{_plain(robot)}.{_plain(kernel)}.{key}"
                with (clock or Clock(robot)).running():
                    found = _made(folder, label, source, (*TARGETS[target][1], *options))
        except OSError as error:
            raise _unusable(folder, error) from None
        _loaded[place] = found
    return _loaded[place]


def _found(folder: Path, key: str) -> ctypes.CDLL | None:
    """A library in the cache; None where there is none that is whole."""
    for path in folder.glob(f"*.{key}.*{_SUFFIX}"):
        with suppress(FileNotFoundError):  # another process empties the cache
            if path.name.split(".")[-2] == _digest(path):
                with suppress(OSError):  # a cache may be read-only
                    os.utime(path)
                try:
                    return ctypes.CDLL(str(path))
                except OSError:
                    if path.exists():
                        raise
                    continue  # another process deleted it since
            path.unlink()  # damaged
    return None


def _made(
    folder: Path, label: str, source: Callable[[], str], flags: tuple[str, ...]
) -> ctypes.CDLL:
    """A library that is compiled now, in the cache from then on."""
    import tempfile

    # Built beside its place and moved there when it is whole: another process sees all or nothing.
    with tempfile.TemporaryDirectory(dir=folder, prefix=_BUILDING) as scratch:
        code, made = Path(scratch, "kernel.c"), Path(scratch, "kernel.so")
        code.write_text(source(), encoding="utf-8")
        _compile(code, made, flags)
        try:
            ctypes.CDLL(str(made))
        except OSError as error:  # it is not kept: another compiler may do better
            cure = f"{_CURE}, or CC to another compiler"
            raise CompilationError(f"{folder} cannot be used: {error}; {cure}") from None
        loaded = ctypes.CDLL(str(made.replace(folder / f"{label}.{_digest(made)}{_SUFFIX}")))
    with suppress(CompilationError):  # the library is good, even if old ones cannot be deleted
        empty_cache(LARGEST)
    return loaded


def _plain(name: str) -> str:
    """A name with characters for a file and at most 40 bytes of the 255 that its name may have."""
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
    return plain.encode()[:40].decode(errors="ignore")


def _compile(code: Path, made: Path, flags: tuple[str, ...]) -> None:
    import subprocess

    output = ["-shared", "-fPIC", str(code), "-o", str(made), "-lm"]
    command = [*compiler(), *_OPTIONS, *flags, *output]
    try:
        result = subprocess.run(command, capture_output=True, errors="replace", check=False)
    except OSError as error:
        raise CompilationError(f"{command[0]} cannot be run: {error.strerror}") from None
    if result.returncode or not made.is_file():
        said = "\n".join(result.stderr.strip().splitlines()[:5])
        said = said or "it wrote no library; set CC to another compiler"
        raise CompilationError(f"{command[0]} failed with code {result.returncode}:\n{said}")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


@cache
def _version() -> bytes:
    """Changes with all code that kernels come from and with the machine; a home can be shared."""
    package = Path(__file__).parents[1]
    paths = sorted(path for pattern in _CODE for path in package.glob(pattern))
    texts = [path.read_bytes() for path in paths]
    return hashlib.sha256(b"\0".join([os.uname().machine.encode(), *texts])).digest()
