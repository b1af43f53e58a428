# SPDX-License-Identifier: BSD-2-Clause
"""From C to loaded libraries: a compiler, and a folder that keeps what it made.

A library is found again by the content that it was made from. Its file's name ends in the hash of
the file itself; the folder is the user's own, so that what is loaded is what was written. When a
new library makes the folder larger than `LARGEST`, those that were loaded longest ago are deleted.
A process that has loaded a library keeps it in memory, so any process may delete any file.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import shutil
import stat
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

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
_log = logging.getLogger(__name__)
_CURE = "XDG_CACHE_HOME names another place"
#: Folders in the cache where libraries are being made; older ones were left by a process that died.
_BUILDING, _DEAD = ".building-", 86_400.0  # seconds


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
    folder = _base() / "sst_pin" / "kernels"
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


def _base() -> Path:
    """The user's folder for caches."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():  # else it does not count, says XDG
        return named
    try:
        home = Path.home()
    except RuntimeError as error:
        raise CompilationError(f"no place for a cache: {error}; {_CURE}") from None
    return home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache"


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


def empty_cache() -> int:
    """Delete all libraries in the cache; how many there were. Those in use stay in memory.

    Folders that a process left when it was killed while it compiled are deleted after a day.

    Raises:
        CompilationError: When they cannot be deleted.
    """
    return _shrink(0)


def _shrink(largest: int) -> int:
    """Delete the libraries last used longest ago until the rest is smaller than this; how many."""
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
) -> ctypes.CDLL:
    """The library of a kernel, from the cache or compiled now.

    `content` is all that the source is made from, `target` one of `TARGETS`. `options` are told to
    the compiler besides; they are the same for each kernel of this name.
    """
    key = hashlib.sha256(b"\0".join([content, kernel.encode(), target.encode(), _version()]))
    folder = cache_folder()
    try:
        flags = (*TARGETS[target][1], *options)
        return _loaded(folder, robot, kernel, key.hexdigest()[:32], target, source, flags)
    except OSError as error:
        raise _unusable(folder, error) from None


def _loaded(
    folder: Path,
    robot: str,
    kernel: str,
    key: str,
    target: str,
    source: Callable[[], str],
    flags: tuple[str, ...],
) -> ctypes.CDLL:
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
    _log.info("compiling %s of %s for %s; the cache keeps it", kernel, robot or "robot", target)
    label = f"{_plain(robot) or 'robot'}.{_plain(kernel)}"
    import tempfile

    # Built beside its place and moved there when it is whole: another process sees all or nothing.
    with tempfile.TemporaryDirectory(dir=folder, prefix=_BUILDING) as scratch:
        code, made = Path(scratch, "kernel.c"), Path(scratch, "kernel.so")
        patience = threading.Timer(1.0, _tell, (robot or "robot",))
        patience.start()
        try:
            code.write_text(source(), encoding="utf-8")
            _compile(code, made, flags)
        finally:
            patience.cancel()
        try:
            ctypes.CDLL(str(made))
        except OSError as error:  # it is not kept: another compiler may do better
            raise CompilationError(
                f"{folder} cannot be used: {error}; {_CURE}, CC another compiler"
            ) from None
        name = f"{label}.{key}.{_digest(made)}{_SUFFIX}"
        loaded = ctypes.CDLL(str(made.replace(folder / name)))
    with suppress(CompilationError):  # the library is good, even if old ones cannot be deleted
        _shrink(LARGEST)
    return loaded


@cache
def _tell(robot: str) -> None:
    """Say once that a person has to wait; without other settings on standard error."""
    _log.warning("sst-pin: compiling kernels of %s; the cache keeps them", robot)


def _plain(name: str) -> str:
    """What can stand in the name of a file, which has at most 255 bytes."""
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
        said = said or "it wrote no library; CC names another compiler"
        raise CompilationError(f"{command[0]} failed with code {result.returncode}:\n{said}")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


@cache
def _version() -> bytes:
    """Changes with the text of the generator and with the kind of machine; a home can be shared."""
    here = Path(__file__).parent
    texts = [path.read_bytes() for path in sorted([*here.glob("*.py"), *here.glob("c/**/*.[ch]")])]
    return hashlib.sha256(b"\0".join([os.uname().machine.encode(), *texts])).digest()
