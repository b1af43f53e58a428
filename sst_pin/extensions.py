# SPDX-License-Identifier: BSD-2-Clause
"""Extension modules that are compiled from the sources beside them, and no others."""

import ctypes
import hashlib
import warnings
from functools import cache
from pathlib import Path

from .errors import CompilationError


def require_current(extension: str | Path, *sources: Path) -> ctypes.CDLL:
    """Load an extension as a library; refuse one that was compiled from other sources, and warn.

    After an update of a clone that is installed with `pip install -e`, the extensions are old. The
    file contains the hash of its sources as the string `made_of`.
    """
    library = ctypes.CDLL(str(extension))
    if all(source.is_file() for source in sources):
        content = b"".join(source.read_bytes() for source in sources)
        if hashlib.sha256(content).hexdigest() != _made_of(library):
            text = f"the extension was compiled from another {sources[0].name}; install sst-pin "
            raise CompilationError(_warned(f"{text}again (in a clone: pip install -e .)"))
    return library


@cache
def missing() -> str:
    """The reason why an extension is missing, with the cure; warns where it hides another."""
    import sysconfig  # slow to import, as the next one
    from importlib.metadata import distributions

    cure = "install sst-pin with a C compiler"
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        cure += " and Python's headers (on Debian: apt install gcc python3-dev)"
    here = Path(__file__).parent
    in_clone = (here.parent / "setup.py").is_file()
    for distribution in distributions(name="sst-pin") if in_clone else ():
        installed = Path(str(distribution.locate_file(here.name)))
        if (installed / "__init__.py").is_file() and installed.resolve() != here.resolve():
            text = "where it is not compiled, and not the one"
            hidden = f"Python imports sst_pin from {here}, {text}"
            if any(installed.glob("compiled/_binding*.so")):
                cure = "start Python in another folder, or pip install -e ."
                return _warned(f"{hidden} installed in {installed}; {cure}")
            return _warned(f"{hidden} in {installed}, which is not compiled either; {cure}")
    return f"the extension module is missing; {cure}"


@cache
def _warned(problem: str) -> str:
    """A problem that makes a robot slow, as a warning at its first appearance."""
    warnings.warn(problem, RuntimeWarning, stacklevel=3)
    return problem


def _made_of(library: ctypes.CDLL) -> str:
    try:
        return (ctypes.c_char * 65).in_dll(library, "made_of").value.decode()
    except ValueError:  # of a version that did not have it
        return ""
