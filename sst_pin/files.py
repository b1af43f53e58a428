# SPDX-License-Identifier: BSD-2-Clause
"""Reads CSV tables, with the line of each error; writes files completely or not at all."""

import csv
import io
import math
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from .arrays import Array, require_flags
from .errors import FileFormatError, InputError, OutputError

#: Writes the content of one file.
Writer = Callable[[BinaryIO], None]
#: Other names of the column of times, which is `t_s`.
_TIME = dict.fromkeys(("time_s", "t", "time"), "t_s")
#: Largest size of a table, [byte].
_LARGEST = 2**30


def as_path(path: str | os.PathLike[str]) -> Path:
    """The path of a file; impossible paths are refused."""
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise InputError("path", f"{path!r} is not the path of a file")
    return Path(path)


def require_ending(path: str | Path, *known: str) -> str:
    """The ending of a file's name, which tells the format."""
    kind = as_path(path).suffix.lower()
    if kind not in known:
        raise OutputError(path, f"ending {kind!r} unknown; known: {', '.join(known)}")
    return kind


class Table(NamedTuple):
    """A CSV of numbers."""

    path: Path  #: Where it came from, for messages.
    columns: tuple[str, ...]  #: Names.
    values: Array  #: Shape (rows, columns).
    lines: tuple[int, ...]  #: Line number of each row in the file, counted from 1.

    def column(self, name: str) -> Array:
        """One column by its name."""
        return self.select([name])[:, 0]

    def select(self, names: Sequence[str]) -> Array:
        """Columns side by side, shape (rows, len(names)); the error names missing ones."""
        missing = [name for name in names if name not in self.columns]
        if missing:
            noun = "column" if len(missing) == 1 else "columns"
            text = f"missing {noun} {', '.join(missing)}"
            raise FileFormatError(self.path, f"{text}; found: {', '.join(self.columns)}")
        return self.values[:, [self.columns.index(name) for name in names]]


def read_table(source: str | Path | BinaryIO, *, timed: bool = True) -> Table:
    """Read a CSV, a file or a stream of bytes, with one header line and, if timed, growing times.

    The column of times is `t_s`; `time_s`, `t` and `time` are taken for it. The error names the
    line.
    """
    if isinstance(source, str | os.PathLike):
        path = as_path(source)
    else:
        path = _stream_name(source)
    reader = csv.reader(io.StringIO(_text(path, source), newline=""), skipinitialspace=True)
    try:
        header = tuple(_TIME.get(name.strip(), name.strip()) for name in next(reader, []))
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise FileFormatError(path, str(error), reader.line_num) from None
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise FileFormatError(path, f"column {twice[0]} appears twice", 1)
    if timed and "t_s" not in header:
        raise FileFormatError(path, f"missing column t_s; found: {', '.join(header) or 'none'}", 1)
    if not rows:
        raise FileFormatError(path, "no rows below the header")
    values = np.array([_numbers(path, line, header, row) for line, row in rows])
    lines = tuple(line for line, _ in rows)
    table = Table(path, header, values, lines)
    if timed:
        _require_increasing_times(table)
    return table


def _text(path: Path, source: str | Path | BinaryIO) -> str:
    """The text of a file or stream; `path` is its name in messages."""
    try:
        if isinstance(source, str | os.PathLike):
            with path.open("rb") as file:
                content = file.read(_LARGEST + 1)
        else:
            content = source.read(_LARGEST + 1)
        if len(content) > _LARGEST:
            raise FileFormatError(path, f"has more than {_LARGEST} bytes")
        return content.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise FileFormatError(path, f"cannot be read: {reason}") from None


def _require_increasing_times(table: Table) -> None:
    """Refuse times that do not increase; the error names the line."""
    times = table.column("t_s")
    not_later = np.flatnonzero(np.diff(times) <= 0)
    if not_later.size:
        i = int(not_later[0])
        text = f"times must increase: t_s = {times[i + 1]:g} after {times[i]:g}"
        raise FileFormatError(table.path, text, table.lines[i + 1])


def _stream_name(source: object) -> Path:
    """The name of a stream of bytes in messages."""
    if not hasattr(source, "read"):
        raise InputError("path", f"{source!r} is not the path of a file")
    name = getattr(source, "name", None)
    return Path(name if isinstance(name, str) else "<stream>")


def _numbers(path: Path, line: int, header: Sequence[str], row: Sequence[str]) -> list[float]:
    if len(row) != len(header):
        raise FileFormatError(path, f"{len(row)} cells, the header has {len(header)}", line)
    numbers = []
    for name, cell in zip(header, row, strict=True):
        try:
            number = float(cell)
            if "_" in cell or not cell.isascii():  # Python's own ways to write numbers
                raise ValueError
        except ValueError:
            raise FileFormatError(path, f"{name}: {cell!r} is not a number", line) from None
        if not math.isfinite(number):
            raise FileFormatError(path, f"{name}: {cell.strip()} is not finite", line)
        numbers.append(number)
    return numbers


def table_writer(columns: Sequence[str], values: Array) -> Writer:
    """A writer of a CSV with all digits, one row for each of `values`."""
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in values.tolist())]
    return text_writer("\n".join(lines) + "\n")


def text_writer(text: str) -> Writer:
    """A writer of a text in UTF-8."""

    def write(file: BinaryIO) -> None:
        file.write(text.encode())

    return write


def write_files(
    files: Mapping[Path, Writer], force: bool = False, *, folder: Path | None = None
) -> None:
    """Write files completely or not at all; existing files are replaced only with `force`.

    All targets are checked before the first is written. Each content goes to a temporary file
    beside its target. When all are complete, they replace the targets; if this fails, the targets
    get their content back. A file that is replaced keeps its mode, and a link to it remains. Only
    `folder` and folders inside it are created if they are missing.
    """
    require_flags(force=force)
    targets = {path: _target_of(as_path(path), force) for path in files}
    if folder is not None:
        parents = [folder.absolute().parent]
    else:
        parents = [target.path.parent for target in targets.values()]
    for parent in parents:
        if not parent.exists():
            raise OutputError(parent, "the folder does not exist; create it first")
    complete = list[_Complete]()
    try:
        for path, write in files.items():
            target = targets[path]
            with _naming(path):
                if folder is not None:
                    target.path.parent.mkdir(parents=True, exist_ok=True)
                temporary = _temporary_file(target, write)
                complete.append(_Complete(path, temporary, target.path))
        _replace(complete)
    finally:
        for file in complete:
            file.temporary.unlink(missing_ok=True)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the file that cannot be written, instead of an error of the operating system."""
    try:
        yield
    except OSError as error:
        raise OutputError(path, f"cannot be written: {error.strerror or error}") from None


class _Target(NamedTuple):
    """A file to be written, and the mode that it has or will have."""

    path: Path
    mode: int


class _Complete(NamedTuple):
    """A temporary file with the whole content of a file.

    Attributes:
        path: The file as the call names it.
        temporary: The temporary file.
        target: The file that it replaces.
    """

    path: Path
    temporary: Path
    target: Path


def _target_of(path: Path, force: bool) -> _Target:
    """The file that a path leads to, beyond links; files that must not be written are refused."""
    try:
        target = Path(os.path.realpath(path))
        mode = target.stat().st_mode
    except FileNotFoundError:
        mask = os.umask(0)  # there is no other way to read it
        os.umask(mask)
        return _Target(target, 0o666 & ~mask)
    except OSError as error:
        raise OutputError(path, f"cannot be written: {error.strerror}") from None
    if not stat.S_ISREG(mode):
        kind = "folder" if stat.S_ISDIR(mode) else "device"
        raise OutputError(path, f"is a {kind}, not a file")
    if not force:
        raise OutputError(path, "exists already; use force (--force) to replace it")
    return _Target(target, stat.S_IMODE(mode))


def _temporary_file(target: _Target, write: Writer) -> Path:
    """A temporary file beside a target, with the content that the target will get."""
    partial = _beside(target.path)
    try:
        with partial.open("wb") as file:
            write(file)
        partial.chmod(target.mode)  # mkstemp makes files that only their owner can read
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    return partial


def _beside(path: Path) -> Path:
    """A new empty file in the folder of a path."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".sst_pin.")
    os.close(handle)
    return Path(name)


def _replace(files: Sequence[_Complete]) -> None:
    """Replace targets by complete files, all or none."""
    copies = dict[Path, Path]()
    done = list[_Complete]()
    try:
        if len(files) > 1:  # the replacement of one file needs no copy
            for file in files:
                if file.target.exists():
                    with _naming(file.path):
                        copies[file.target] = _beside(file.target)
                        shutil.copy2(file.target, copies[file.target])
        for file in files:
            with _naming(file.path):
                file.temporary.replace(file.target)
            done.append(file)
    except BaseException:
        for file in done:
            with _naming(file.path):
                if file.target in copies:
                    copies[file.target].replace(file.target)
                else:
                    file.target.unlink(missing_ok=True)
        raise
    finally:
        for copy in copies.values():
            copy.unlink(missing_ok=True)
