# SPDX-License-Identifier: BSD-2-Clause
"""Assignments to a robot that would have no effect are refused, with what to do instead."""

from difflib import get_close_matches

from .errors import AssignmentError

_CURES = {
    "model": "change its contents, such as robot.model.gravity.linear = [0, 0, -1.62], and call "
    "refresh(), or build another robot",
    "closures": "build another robot: ClosedChain(robot.model, closures, ...)",
    "forces": "build another robot: ClosedChain(..., forces=[...])",
    "actuated": "build another robot with these motors: ClosedChain(..., actuated=[names])",
    "motor_names": "build another robot with these motors: ClosedChain(..., actuated=[names])",
    "coordinates": "build another robot: ClosedChain(..., coordinates=[names])",
    "degrees_of_freedom": "it follows from the joints and the closures",
    "friction": "change robot.model.damping and robot.model.friction and call refresh(), or build "
    "another robot with viscous_friction= and coulomb_friction=",
    "path": "call compile() to get kernels",
    "parameters": "build another robot: SST(parameters)",
    "geometry": "change robot.model and call refresh(), or build another robot: SST(parameters)",
    "home": "of an SST it follows from the geometry; for other robots set "
    "robot.model.referenceConfigurations['home'] and call refresh()",
}


def require_assignable(robot: object, name: str) -> None:
    """Refuse an attribute that is computed or that robots do not have, and say the cure.

    Classes derived outside this package may have attributes of their own.
    """
    kind = type(robot)
    if name.startswith("_"):
        return
    found = getattr(kind, name, None)
    if isinstance(found, property):
        if found.fset is not None:
            return
        cure = _CURES.get(name, "it is computed from the model")
        raise AssignmentError(name, f"cannot be assigned; {cure}")
    if callable(found):
        raise AssignmentError(name, f"is a method of {kind.__name__} and cannot be replaced")
    own = kind.__module__.partition(".")[0] == __name__.partition(".")[0]
    declared = any(name in vars(base).get("__annotations__", {}) for base in kind.__mro__)
    if own and found is None and not declared:
        public = [word for word in dir(kind) if not word.startswith("_")]
        near = get_close_matches(name, public, 1)
        meant = f"; did you mean {near[0]}?" if near else "; keep your own data in another object"
        raise AssignmentError(name, f"{kind.__name__} has no such attribute{meant}")
