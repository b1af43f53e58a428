# SPDX-License-Identifier: BSD-2-Clause
"""The C compiler: its command, its options for each instruction set, its errors."""

import os
import shutil
import sys
import threading
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from ..errors import CompilationError, install_command

_AVX2 = ("-mavx2", "-mfma")
_AVX512 = ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mfma", "-mprefer-vector-width=512")


class Target(NamedTuple):
    """An instruction set with a number of samples in a vector."""

    lanes: int
    #: Options of the compiler.
    options: tuple[str, ...]


TARGETS = {
    "avx512": Target(8, _AVX512),
    "avx2": Target(4, _AVX2),
    "plain": Target(2, ()),
    "avx2_one": Target(1, _AVX2),
    "plain_one": Target(1, ()),
    # For C by CasADi: with more optimisation it compiles twice as long and runs no faster.
    "scalar": Target(1, ("-O1",)),
}
#: The target for a single sample: scalars take less time than a vector of equal numbers.
SINGLE = {"avx512": "avx2_one", "avx2": "avx2_one", "plain": "plain_one"}
#: Options for derivatives: with -O2 their long functions compile slower and run no faster.
LONG = ("-O1", "-fexpensive-optimizations")
_OPTIONS = ("-std=gnu11", "-O2", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
#: Sources of more characters than this are long. GCC compiles shorter ones in about half a second,
#: with and without the options for long ones, so that the usual options stay.
_LONG_SOURCE = 200_000
#: Options for long sources, for compilers that know them (GCC). They switch off passes of the
#: compiler whose time grows faster than the function. Most of these passes look for values that are
#: computed twice and for results that nobody reads; the generator has removed both. Measured with
#: GCC 12: a long source compiles in 0.6 to 0.7 of the time, and runs as fast. The pass for ranges
#: of values (vrp) finds nothing in floating-point numbers; without it, accelerations of 54
#: coordinates compile in 10 s, not in more than 160 s.
_FOR_LONG_SOURCES = (
    *("--param", "max-cselib-memory-locations=20"),
    *("-fno-tree-fre", "-fno-tree-pre", "-fno-rerun-cse-after-loop"),
    *("-fno-tree-dse", "-fno-dse"),
    "-fno-tree-vrp",
    *("-fno-ipa-modref", "-fno-ipa-pure-const", "-fno-ipa-reference"),
)

_PROCESSORS = os.cpu_count() or 1
#: Processes of the compiler that may run at once, in all threads.
_PROCESSES = threading.BoundedSemaphore(_PROCESSORS)


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
        "no C compiler found; install one (on Debian: apt install gcc), or run: "
        + install_command("compiler")
    )


def compile_library(sources: Sequence[str], library: Path, options: Sequence[str]) -> None:
    """Compile sources of C to a shared library.

    Each source is compiled by a process of its own; as many run at once as there are processors.

    Args:
        sources: The C, file by file.
        library: Where the library goes; intermediate files go beside it.
        options: Options after the usual ones, which they override.

    Raises:
        CompilationError: If there is no compiler, or it fails.
    """
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    objects = [library.with_name(f"{library.stem}_{k}.o") for k in range(len(sources))]

    def compile_one(source: str, target: Path) -> None:
        code = target.with_suffix(".c")
        code.write_text(source, encoding="utf-8")
        all_options = [*_OPTIONS, *options]
        if len(source) > _LONG_SOURCE and _accepts(tuple(compiler()), _FOR_LONG_SOURCES):
            all_options += _FOR_LONG_SOURCES
        with _PROCESSES:
            _run([*all_options, "-c", "-fPIC", str(code), "-o", str(target)], target)

    with ThreadPoolExecutor(_PROCESSORS) as pool:  # by default at most 32 threads
        for _ in pool.map(compile_one, sources, objects):
            pass
    _run(["-shared", *map(str, objects), "-o", str(library), "-lm"], library)


@cache
def _accepts(command: tuple[str, ...], options: tuple[str, ...]) -> bool:
    """Whether a compiler knows these options."""
    import subprocess

    arguments = [*command, *options, "-Werror", "-fsyntax-only", "-x", "c", os.devnull]
    try:
        return subprocess.run(arguments, capture_output=True, check=False).returncode == 0
    except OSError:
        return False  # `_run` says what is wrong with the compiler


def _run(arguments: Sequence[str], result: Path) -> None:
    """Run the compiler with these arguments; it has to write the file `result`."""
    import subprocess

    command = [*compiler(), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, errors="replace", check=False)
    except OSError as error:
        raise CompilationError(f"{command[0]} cannot be run: {error.strerror}") from None
    message = "\n".join(done.stderr.strip().splitlines()[:5])
    if done.returncode:
        message = message or "it says nothing; set CC to another compiler"
        raise CompilationError(f"{command[0]} failed with code {done.returncode}:\n{message}")
    if not result.is_file():
        problem = f"{command[0]} wrote no file; set CC to another compiler"
        raise CompilationError(f"{problem}\n{message}".rstrip())
