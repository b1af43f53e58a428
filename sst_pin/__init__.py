# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of closed-chain robots on Pinocchio by the natural orthogonal complement.

`__init__.pyi` lists the public names; each is imported at its first use.
"""

from lazy_loader import attach_stub

_public, __dir__, _names = attach_stub(__name__, __file__)
#: What `from sst_pin import *` takes: all but the rooms that need an extra.
__all__ = sorted({*_names} - {"__version__", "plots", "viewer"})  # noqa: PLE0605

#: Names that are now in `sst_pin.sst`. They work here for one version, with a warning.
_OF_SST = {
    "BRANCHES",
    "MJCF_PATH",
    "PACKAGE_PATH",
    "REPOSITORY_PATH",
    "SRDF_PATH",
    "YAML_PATH",
    "PlatformMotion",
    "RigidBody",
    "interpolate_orientations",
    "orientation",
    "orientation_motion",
    "orientation_path",
}


def __getattr__(name: str) -> object:
    if name not in _OF_SST:
        return _public(name)
    from . import sst
    from .errors import warn_caller

    warn_caller(f"sst_pin.{name} is now sst_pin.sst.{name}", DeprecationWarning)
    return getattr(sst, name)
