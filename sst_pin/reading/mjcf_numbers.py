# SPDX-License-Identifier: BSD-2-Clause
"""Impossible numbers in an MJCF that MuJoCo accepts: not finite, or negative at a joint."""

from collections.abc import Iterator

import numpy as np

from .mjcf_compiled import Compiled

#: Fields of MuJoCo's model that are read, by the kind of element that is the first part of their
#: names: `body_pos`, `body_quat` and so on.
_FIELDS_READ = {
    "body": ("pos", "quat", "ipos", "iquat", "mass", "inertia"),
    "jnt": ("pos", "axis", "range", "stiffness"),
    "dof": ("armature", "damping", "frictionloss"),
    "site": ("pos", "quat"),
    "eq": ("data",),
    "key": ("qpos",),
}


def impossible_numbers(compiled: Compiled) -> Iterator[str]:
    """Problems of numbers that cannot be right."""
    mj = compiled.mj
    for kind, fields in _FIELDS_READ.items():
        for field in fields:
            array = getattr(mj, f"{kind}_{field}")
            if field == "range":  # infinite means that there is no limit
                not_finite = np.isnan(array)
            else:
                not_finite = ~np.isfinite(array)
            negative = np.zeros_like(not_finite)
            if kind == "dof":
                negative = array < 0
            impossible = np.unique(np.nonzero(not_finite | negative)[0])  # elements, in the rows
            for i in map(int, impossible):
                text = f"{array[i]:g} is negative" if negative[i].any() else "is not finite"
                yield f"{_element(compiled, kind, i)}: {field} {text}"
    if not np.isfinite(mj.opt.gravity).all():
        yield "gravity is not finite"
    if not np.isfinite(mj.qpos0).all():
        yield "a joint's ref is not finite"


def _element(compiled: Compiled, kind: str, i: int) -> str:
    """Kind and name of an element in the words of an MJCF, such as "joint knee"."""
    if kind == "dof":
        return f"joint {compiled.joint_name(compiled.mj.dof_jntid[i])}"
    if kind == "jnt":
        return f"joint {compiled.joint_name(i)}"
    word = "equality" if kind == "eq" else kind
    return f"{word} {compiled.name(word, i)}"
