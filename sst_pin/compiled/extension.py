# SPDX-License-Identifier: BSD-2-Clause
"""Loads the extension module `_binding`, which calls kernels, or says why it cannot."""

import hashlib
from functools import cache
from pathlib import Path
from types import ModuleType

from ..errors import CompilationError, install_command

_FOLDER = Path(__file__).parent
_SOURCES = [_FOLDER / name for name in ("_binding.pyx", "batches.h")]


@cache
def binding() -> ModuleType:
    """The extension module.

    Raises:
        CompilationError: If it is missing, or was compiled from other sources than those beside it,
            as after an update of a clone that is installed with `pip install -e`.
    """
    try:
        from . import _binding
    except ImportError as error:
        raise CompilationError(f"{_missing()} ({error})") from None
    if all(source.is_file() for source in _SOURCES):
        content = b"".join(source.read_bytes() for source in _SOURCES)
        if hashlib.sha256(content).hexdigest() != _binding.SOURCES:
            raise CompilationError(
                f"{_binding.__file__} was compiled from other sources; run: {install_command()}"
            )
    return _binding


def _missing() -> str:
    """What to say if there is no extension module: what is wrong, and the cure."""
    package = _FOLDER.parent
    compiler = "a C compiler and Python's headers (on Debian: apt install gcc python3-dev)"
    cure = f"install {compiler} and run: {install_command()}"
    if (package.parent / "setup.py").is_file():
        # In a clone, Python finds this package before an installed one that is compiled.
        cure += ", or start Python outside the clone"
    return f"the extension module is not compiled in {package}; {cure}"
