# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement.

Public names are loaded at their first use.
"""

from importlib import import_module
from importlib.util import find_spec

from .version import __version__ as __version__

#: Rooms that need an extra, and a package that it brings.
_OPTIONAL = {"plots": "matplotlib", "viewer": "meshcat"}
#: The module of each public name; `__init__.pyi` lists them as `from .module import Name as Name`.
with open(f"{__file__}i", encoding="utf-8") as _stub:  # noqa: PTH123 (pathlib takes time to import)
    _LINES = [line.split() for line in _stub if line.startswith("from ")]
_MODULES = {name: module for _, module, _, name, *_ in _LINES if module not in (".", ".version")}

__all__ = sorted([*_MODULES, "robots"])  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """A public name, or a room of the package, when it is first asked for."""
    if name in _MODULES:
        value = getattr(import_module(_MODULES[name], __name__), name)
    elif name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    else:
        try:
            value = import_module(f".{name}", __name__)
        except ModuleNotFoundError as error:
            if error.name != f"{__name__}.{name}":
                raise
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    there = (room for room, package in _OPTIONAL.items() if find_spec(package))
    return sorted([*__all__, "__version__", *there])
