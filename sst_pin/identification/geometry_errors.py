# SPDX-License-Identifier: BSD-2-Clause
"""Errors of a geometry as joints of an enlarged robot: three slides, three hinges at each place.

The natural orthogonal complement of this robot has the derivatives of a pose by the errors, with
closed loops.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import InputError, UnknownNameError
from ..model.closures import Coupling, frames_of
from ..model.joint_series import Series
from ..model.rebuilt_tree import rebuilt
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..summaries import listed

_JOINTS = {
    "x": pin.JointModelPX(),
    "y": pin.JointModelPY(),
    "z": pin.JointModelPZ(),
    "rx": pin.JointModelRX(),
    "ry": pin.JointModelRY(),
    "rz": pin.JointModelRZ(),
}
#: What the joints do not close of an error, free of units, counts as none below this.
_CLOSED = 1e-6
#: The measured frame of the enlarged robot, and what the names of the others end with.
FRAME, _MOVED = "measured frame", " moved"


def enlarged(
    chain: ClosedChain, frame: str, which: Sequence[str] | None
) -> tuple[ClosedChain, list[str]]:
    """The robot whose geometry can err, and the names of the errors that are independent."""
    tree, closures = chain.mechanism.model, chain.closures
    ends = [end for c in closures if not isinstance(c, Coupling) for end in frames_of(c)]
    frame_id(tree, frame)
    places = list(dict.fromkeys([*list(tree.names)[1:], *ends, frame]))
    names = [f"{place}.{axis}" for place in places for axis in _JOINTS]
    patterns = [f"{place}.*" for place in places if place != frame] if which is None else which
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownNameError("error of the geometry", pattern, names)
    errors = [name for name in names if any(fnmatchcase(name, p) for p in patterns)]
    of_place: dict[str, dict[str, object]] = {}
    for name in errors:
        place, _, axis = name.rpartition(".")
        of_place.setdefault(place, {})[f".{axis}"] = _JOINTS[axis]
    joints = {tree.getJointId(place) for place in of_place if tree.existJointName(place)}
    parts = {j: {**of_place[tree.names[j]], "": tree.joints[j]} for j in joints}
    model = rebuilt(tree, {j: Series.named(x) for j, x in parts.items()})
    for place in dict.fromkeys([*ends, frame]):
        own = model.frames[frame_id(model, place)]
        bearer, at = own.parentJoint, own.placement
        joints_here = {} if tree.existJointName(place) else of_place.get(place, {})
        for suffix, joint in joints_here.items():
            bearer = model.addJoint(bearer, joint, at, place + suffix)
            at = pin.SE3.Identity()
        for new in [place + _MOVED] * (place in ends) + [FRAME] * (place == frame):
            model.addFrame(pin.Frame(new, bearer, at, pin.FrameType.OP_FRAME))
    for pair in list(model.referenceConfigurations):  # of the tree without errors
        del model.referenceConfigurations[pair.key()]
    others = []
    for closure in closures:
        named = () if isinstance(closure, Coupling) else frames_of(closure)
        changed = {key: x + _MOVED for key, x in vars(closure).items() if x in named}
        others.append(replace(closure, **changed))
    large = ClosedChain(model, others, [*chain.coordinates, *errors])
    if lost := set(chain.coordinates) - set(large.coordinates):
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large, [name for name in errors if name in large.coordinates]


def opening(
    large: ClosedChain, errors: list[str], drawn: Sequence[Mapping[str, float]]
) -> list[str]:
    """The errors that alone open the loops of the robot as it is drawn, in all its poses."""
    model = large.mechanism.model
    columns = [model.joints[model.getJointId(name)].idx_v for name in errors]
    least = np.full(len(errors), np.inf)
    for positions in drawn:
        Phi = large.Phi(without_errors(large, positions)) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        closing = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        E = Phi[:, columns]
        least = np.minimum(least, np.linalg.norm(E - closing @ (closing.T @ E), axis=0))
    return [name for name, size in zip(errors, least, strict=True) if size > _CLOSED]


def without_errors(large: ClosedChain, positions: Mapping[str, float]) -> Array:
    """The configuration of the enlarged robot where that without errors has given positions."""
    q = pin.neutral(large.mechanism.model)
    for k, name in enumerate(large.position_names):
        q[k] = positions.get(name, q[k])
    return np.asarray(q, float)


def placements(names: Sequence[str], values: Array) -> dict[str, pin.SE3]:
    """The errors of each place as one placement: slides first, then hinges, as in _JOINTS."""
    found: dict[str, pin.SE3] = {}
    for name, value in zip(names, values, strict=True):
        place, _, axis = name.rpartition(".")
        unit = np.eye(3)["xyz".index(axis[-1])] * value
        step = pin.SE3(pin.exp3(unit), np.zeros(3)) if len(axis) > 1 else pin.SE3(np.eye(3), unit)
        found[place] = found.get(place, pin.SE3.Identity()) * step
    return found


def moved(chain: ClosedChain, errors: dict[str, pin.SE3]) -> ClosedChain:
    """The robot with its joints and frames where the errors put them."""
    model = pin.Model(chain.mechanism.model)
    for place, error in errors.items():
        if model.existJointName(place):
            k = model.getJointId(place)
            model.jointPlacements[k] = model.jointPlacements[k] * error
        else:
            at = model.frames[frame_id(model, place)]
            at.placement = at.placement * error
    return chain.with_model(model)
