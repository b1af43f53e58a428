# SPDX-License-Identifier: BSD-2-Clause
"""Shared libraries of kernels: compiled once, kept in the user's cache folder, loaded.

`load` returns a library, `text` the file of a kernel that another compiler translates (Warp's), and
`Code` finds the functions of a kernel in a loaded library.

The name of a file has the hash of all that it is made from. A process keeps a library in memory, so
any process may delete any file.
"""

import ctypes
import hashlib
import logging
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from platformdirs import user_cache_path

from ..arrays import Array
from ..errors import CompilationError
from .compiler import TARGETS, compile_library

#: The largest total size of the libraries in the cache, [bytes].
LARGEST = 2**30
#: Patterns of the files of this package that affect the content of a kernel.
_CODE = (
    *("model/*.py", "loops/*.py", "dynamics/*.py"),
    *("compiled/*.py", "compiled/c/**/*.[ch]", "version.py"),
)
#: The most sizes in a list of sizes of a library; the list ends with -1.
_MOST_SIZES = 8
#: What to do if the cache folder cannot be used.
_CURE = "set XDG_CACHE_HOME to another folder"
_log = logging.getLogger(__name__)
#: The libraries that this process has loaded, by their paths.
_loaded: dict[Path, ctypes.CDLL] = {}
#: Held while a compilation is announced.
_ANNOUNCING = threading.Lock()


class Sizes(NamedTuple):
    """Numbers of entries of the arrays of a function, in the order of its list of sizes."""

    #: Of p: the parameters and the constants that are computed from them.
    parameters: int
    #: Of the result.
    output: int
    #: Of each input.
    inputs: tuple[int, ...]


@dataclass(frozen=True)
class Code:
    """A kernel in a loaded library; the names of its functions end in `entry`."""

    library: ctypes.CDLL
    entry: str

    def sizes(self, function: str) -> Sizes:
        """Sizes of the arrays of a function."""
        name = f"sizes_{function}_{self.entry}"
        numbers = list((ctypes.c_int * _MOST_SIZES).in_dll(self.library, name))
        parameters, output, *inputs = numbers[: numbers.index(-1)]
        return Sizes(parameters, output, tuple(inputs))

    def address(self, function: str) -> int:
        """Address of a function: "run", or "rate" of a rollout."""
        pointer = getattr(self.library, f"{function}_{self.entry}")
        address = ctypes.cast(pointer, ctypes.c_void_p).value
        assert address is not None
        return address

    def prepared(self, numbers: Array) -> Array:
        """Parameters, followed by the constants that the kernel computes from them."""
        constants = np.zeros(self.sizes("run").parameters - len(numbers))
        p = np.concatenate([numbers, constants])
        getattr(self.library, f"prepare_{self.entry}")(ctypes.c_void_p(p.ctypes.data))
        return p


class CachedLibrary(NamedTuple):
    """A library in the cache."""

    path: Path
    robot: str
    kernel: str
    #: Size of the file, [bytes].
    size: int
    #: When it was last loaded, in seconds since 1970.
    used: float


def cache_folder() -> Path:
    """The user's cache folder of kernels; a folder that others can write to is refused."""
    try:
        folder = user_cache_path("sst_pin", appauthor=False) / "kernels"
    except RuntimeError as error:  # a user without a home
        raise CompilationError(f"no place for a cache: {error}") from None
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        raise _unusable(folder, error) from None
    if status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise CompilationError(
            f"{folder} is not safe: it must belong to you, and only you may write to it "
            f"(chmod 700 {folder})"
        )
    return folder


def cached() -> list[CachedLibrary]:
    """All libraries in the cache, the most recently used first."""
    libraries = []
    folder = cache_folder()
    for path in [*folder.glob("*.*.*.so"), *folder.glob("*.*.*.py")]:
        robot, kernel, *_ = path.name.rsplit(".", 3)
        with suppress(FileNotFoundError):  # another process deletes it
            status = path.stat()
            libraries.append(CachedLibrary(path, robot, kernel, status.st_size, status.st_mtime))
    return sorted(libraries, key=lambda library: -library.used)


def delete(largest: int = 0) -> int:
    """Delete the least recently used libraries until the rest is smaller than `largest`, [bytes].

    The result is the number of deleted libraries. Processes that use a deleted library keep it in
    memory.
    """
    count = total = 0
    for library in cached():
        total += library.size
        if total >= largest:
            count += 1
            try:
                library.path.unlink(missing_ok=True)  # another process may have deleted it
            except OSError as error:
                raise _unusable(library.path.parent, error) from None
    return count


def load(
    robot: str,
    kernel: str,
    content: bytes,
    target: str,
    sources: Callable[[], Sequence[str]],
    options: Sequence[str] = (),
) -> ctypes.CDLL:
    """The library of a kernel: of this process, from the cache, or compiled now.

    Args:
        robot: Name of the robot, for the name of the file and for messages.
        kernel: Name of the kernel.
        content: All that the sources are made from; it is part of the hash in the file's name.
        target: One of `TARGETS`.
        sources: Returns the C, file by file. It is called only if there is no library yet.
        options: More options of the compiler, the same for each kernel of this name.
    """
    path = _path(robot, kernel, content, target, ".so")
    if path not in _loaded:
        library = _from_cache(path)
        if library is None:
            _announce(robot)
            _log.info("compiling %s of %s for %s; the cache keeps it", kernel, robot, target)
            library = _compiled(path, sources(), (*TARGETS[target].options, *options))
        _loaded[path] = library
    return _loaded[path]


def text(robot: str, kernel: str, content: bytes, source: Callable[[], str]) -> Path:
    """The file of the cache with the text of a kernel, written now if it is missing.

    The arguments are those of `load`; `source` returns the text.
    """
    path = _path(robot, kernel, content, "text", ".py")
    if not path.is_file():
        _store_whole(path, lambda part: part.write_text(source(), "utf-8"))
    with suppress(OSError):  # a cache may be read-only
        os.utime(path)  # it is used now
    return path


def _path(robot: str, kernel: str, content: bytes, target: str, suffix: str) -> Path:
    """The path of a kernel in the cache: the robot, the kernel, a hash, and the suffix."""
    parts = [content, kernel.encode(), target.encode(), _version()]
    key = hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]
    return cache_folder() / f"{_file_name(robot or 'robot')}.{_file_name(kernel)}.{key}{suffix}"


def _store_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Store a file at its place when it is complete: others see the whole file or none."""
    part = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    try:
        write(part)
        part.replace(path)
    except OSError as error:
        raise _unusable(path.parent, error) from None


def _announce(robot: str) -> None:
    """Announce once in a process that the first call compiles for seconds."""
    with _ANNOUNCING:  # kernels are compiled in several threads
        _announce_once(robot)


@cache
def _announce_once(robot: str) -> None:
    _log.warning("sst-pin: compiling kernels of %s; the cache keeps them", robot)


def _from_cache(path: Path) -> ctypes.CDLL | None:
    """The loaded library at a path of the cache; None if it is missing or cannot be loaded."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError:
        return None
    with suppress(OSError):  # a cache may be read-only
        os.utime(path)  # it is used now
    return library


def _compiled(path: Path, sources: Sequence[str], options: Sequence[str]) -> ctypes.CDLL:
    """A library that is compiled now, stored at a path, and loaded."""

    def write(part: Path) -> None:
        with tempfile.TemporaryDirectory() as scratch:
            compile_library(sources, Path(scratch, "kernel.so"), options)
            shutil.copyfile(Path(scratch, "kernel.so"), part)

    _store_whole(path, write)
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        path.unlink(missing_ok=True)  # another compiler may succeed
        cure = f"{_CURE}, or CC to another compiler"
        raise CompilationError(f"{path.parent} cannot be used: {error}; {cure}") from None
    with suppress(CompilationError):  # the library is good, even if others cannot be deleted
        delete(LARGEST)
    return library


def _unusable(folder: Path, error: OSError) -> CompilationError:
    return CompilationError(f"{folder} cannot be used: {error.strerror or error}; {_CURE}")


def _file_name(name: str) -> str:
    """A name for a part of a file name: plain characters, at most 40 bytes."""
    plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
    return plain.encode()[:40].decode(errors="ignore")


@cache
def _version() -> bytes:
    """Hash of the machine, because home folders can be shared, and of all code of the generator."""
    package = Path(__file__).parents[1]
    paths = sorted(path for pattern in _CODE for path in package.glob(pattern))
    texts = [path.read_bytes() for path in paths]
    return hashlib.sha256(b"\0".join([os.uname().machine.encode(), *texts])).digest()
