# SPDX-License-Identifier: BSD-2-Clause
"""The configuration space of a tree: names and units of the entries of q and v, and q_dot from v.

The first functions describe single joints; `JointSpace` describes all joints of a tree. Most joints
have the same number of entries in q and in v, and q_dot = v. The others are:

    joint        entries of q                      rates in v
    ball         quaternion (x, y, z, w)           angular velocity, axes of the body
    free-flyer   position, quaternion              linear and angular velocity, axes of the body
    planar       x, y, cosine and sine             vx and vy in axes of the body, and w
    continuous   cosine and sine                   its rate

Quaternions and cosine-sine pairs are called unit vectors: q is valid if their length is one.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices, finite_array
from ..errors import InputError, UnknownNameError

#: Largest error of the length of a unit vector in q: six digits are enough.
_LENGTH_ERROR = 1e-6


class _Kind(NamedTuple):
    """The entries of one type of joint in q and v.

    The name of an entry is the name of the joint with a suffix, such as "hip_qx"; the suffix is
    empty if the joint has one entry.
    """

    #: Suffixes of its entries of q.
    q: tuple[str, ...]
    #: Suffixes of its entries of v.
    v: tuple[str, ...]
    #: Units of its entries of v, without "per second".
    units: tuple[str, ...]


class _Start(NamedTuple):
    """Indices of the first entry of a joint, or of a part of it, in q and in v."""

    q: int
    v: int


class _Entry(NamedTuple):
    """An entry of q or of v."""

    name: str
    unit: str


_XYZ = ("x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_TURNS = ("wx", "wy", "wz")
_JOINTS_OF_SEVERAL_RATES = {
    "JointModelFreeFlyer": _Kind(
        _XYZ + _QUATERNION, ("vx", "vy", "vz", *_TURNS), ("m",) * 3 + ("rad",) * 3
    ),
    "JointModelSpherical": _Kind(_QUATERNION, _TURNS, ("rad",) * 3),
    "JointModelTranslation": _Kind(_XYZ, ("vx", "vy", "vz"), ("m",) * 3),
    "JointModelPlanar": _Kind(("x", "y", "cos", "sin"), ("vx", "vy", "w"), ("m", "m", "rad")),
    "JointModelSphericalZYX": _Kind(("rz", "ry", "rx"), ("rz", "ry", "rx"), ("rad",) * 3),
    "JointModelUniversal": _Kind(("1", "2"), ("1", "2"), ("rad",) * 2),
}
#: A continuous joint: a cosine and a sine.
_UNBOUNDED = _Kind(("cos", "sin"), ("",), ("rad",))


def kind_of(joint: Any) -> _Kind:
    """Names and units of a joint that is not a composite."""
    short = joint.shortname()
    if short in _JOINTS_OF_SEVERAL_RATES:
        return _JOINTS_OF_SEVERAL_RATES[short]
    if is_continuous(joint):
        return _UNBOUNDED
    if joint.nq == 1 and joint.nv == 1:
        unit = "m" if short.startswith("JointModelP") else "rad"
        return _Kind(("",), ("",), (unit,))
    # Another joint of several entries; they are numbered.
    numbers = tuple(map(str, range(max(joint.nq, joint.nv))))
    return _Kind(numbers[: joint.nq], numbers[: joint.nv], ("rad",) * joint.nv)


def _joints_in(joint: Any) -> list[tuple[Any, str]]:
    """The joints that a composite consists of, each with a suffix; another joint by itself."""
    if joint.shortname() != "JointModelComposite":
        return [(joint, "")]
    composite = joint.extract() if hasattr(joint, "extract") else joint
    joints = []
    for number, inner in enumerate(composite.joints, start=1):
        for inner_joint, suffix in _joints_in(inner):  # a composite may contain composites
            joints.append((inner_joint, f"_{number}{suffix}"))
    return joints


def is_continuous(joint: Any) -> bool:
    """Whether a joint turns without limits, so that q has the cosine and the sine of its angle."""
    return bool(joint.nq == 2 and joint.nv == 1)


def _entries_of_q(joint: Any, name: str) -> list[_Entry]:
    """The entries of q of a joint with this name."""
    kind = kind_of(joint)
    units_of_rates = dict(zip(kind.v, kind.units, strict=True))
    entries = []
    for suffix in kind.q:
        # x, y and z are lengths. Angles have the suffixes of their rates. Other entries, of unit
        # vectors, have no unit.
        unit = "m" if suffix in _XYZ else units_of_rates.get(suffix, "")
        entries.append(_Entry(f"{name}_{suffix}" if suffix else name, unit))
    return entries


def _entries_of_v(joint: Any, name: str) -> list[_Entry]:
    """The entries of v of a joint with this name."""
    kind = kind_of(joint)
    entries = []
    for suffix, unit in zip(kind.v, kind.units, strict=True):
        entries.append(_Entry(f"{name}_{suffix}" if suffix else name, unit))
    return entries


class JointSpace:
    """The meaning of q (nq,) and v (nv,) of a tree.

    Attributes:
        joint_names: Names of the joints.
        position_names: Names of the entries of q: the name of the joint, with a suffix if it has
            several entries.
        rate_names: Names of the entries of v, in the same way.
        position_units: "rad", "m", or "" for quaternions, cosines and sines.
        rate_units: "rad" or "m" for each entry of v.
        names_by_joint: Names of the entries of each joint, by "position" and "rate".
    """

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self.joint_names: tuple[str, ...] = tuple(list(model.names)[1:])
        positions: list[_Entry] = []
        rates: list[_Entry] = []
        # Where the entries with q_dot != v begin.
        self._quaternions: list[_Start] = []
        self._cosines: list[_Start] = []  # cosine and sine of an angle
        self._free_positions: list[_Start] = []  # x, y, z of free-flyers
        self._plane_positions: list[_Start] = []  # x, y of planar joints
        self.names_by_joint: dict[str, dict[str, list[str]]] = {"position": {}, "rate": {}}
        for name, joint in zip(self.joint_names, list(model.joints)[1:], strict=True):
            positions_of_joint: list[_Entry] = []
            rates_of_joint: list[_Entry] = []
            for part, suffix in _joints_in(joint):
                i = len(positions) + len(positions_of_joint)
                k = len(rates) + len(rates_of_joint)
                self._note_starts(part, i, k)
                positions_of_joint += _entries_of_q(part, name + suffix)
                rates_of_joint += _entries_of_v(part, name + suffix)
            positions += positions_of_joint
            rates += rates_of_joint
            self.names_by_joint["position"][name] = [entry.name for entry in positions_of_joint]
            self.names_by_joint["rate"][name] = [entry.name for entry in rates_of_joint]
        self.position_names = tuple(entry.name for entry in positions)
        self.position_units = tuple(entry.unit for entry in positions)
        self.rate_names = tuple(entry.name for entry in rates)
        self.rate_units = tuple(entry.unit for entry in rates)

    def _note_starts(self, joint: Any, i: int, k: int) -> None:
        """Note the entries with q_dot != v of a joint whose entries begin at q[i] and v[k]."""
        short = joint.shortname()
        if short == "JointModelFreeFlyer":
            self._free_positions.append(_Start(i, k))
            self._quaternions.append(_Start(i + 3, k + 3))
        elif short == "JointModelSpherical":
            self._quaternions.append(_Start(i, k))
        elif short == "JointModelPlanar":
            self._plane_positions.append(_Start(i, k))
            self._cosines.append(_Start(i + 2, k + 2))
        elif is_continuous(joint):
            self._cosines.append(_Start(i, k))

    @cached_property
    def indices_of_positions(self) -> dict[str, list[int]]:
        """Indices in q of each angle or length, by name; two for a cosine and a sine."""
        indices: dict[str, list[int]] = {}
        for i, name in enumerate(self.position_names):
            if self.position_units[i]:  # the entries of unit vectors have none
                indices[name] = [i]
        for i, _ in self._cosines:
            name = self.position_names[i].removesuffix("_cos")
            indices[name] = [i, i + 1]
        return indices

    def rates_of(self, names: Sequence[str]) -> Indices:
        """Indices in v of joints, or of single rates, by name."""
        indices: list[int] = []
        for name in names:
            if name in self.joint_names and name not in self.rates:
                raise InputError(
                    "names", f"{name} is a mimic joint; name the joint that it follows"
                )
            if name in self.rates:
                indices.extend(self.rates[name])
            elif name in self.rate_names:
                indices.append(self.rate_names.index(name))
            else:
                known = dict.fromkeys((*self.joint_names, *self.rate_names))
                raise UnknownNameError("joint", name, known)
        if len(set(indices)) != len(indices):
            raise InputError("names", f"a joint appears twice in {list(names)}")
        return np.array(indices, dtype=np.intp)

    def names_of(self, rates: Sequence[int]) -> tuple[str, ...]:
        """Names for which `rates_of` returns these; a joint's name stands for all its rates."""
        names: list[str] = []
        indices = [int(k) for k in rates]
        i = 0
        while i < len(indices):
            name = self.joint_of_rate[indices[i]]
            all_rates = list(self.rates[name])
            if indices[i : i + len(all_rates)] == all_rates:
                names.append(name)
                i += len(all_rates)
            else:
                names.append(self.rate_names[indices[i]])
                i += 1
        return tuple(names)

    @cached_property
    def rates(self) -> dict[str, range]:
        """Indices in v of each joint by name, without mimic joints."""
        rates = {}
        for name, joint in zip(self.joint_names, list(self._model.joints)[1:], strict=True):
            if joint.nv:
                rates[name] = range(joint.idx_v, joint.idx_v + joint.nv)
        return rates

    @cached_property
    def joint_of_rate(self) -> dict[int, str]:
        """Name of the joint of each rate, by its index in v."""
        joints: dict[int, str] = {}
        for name, rates in self.rates.items():
            for k in rates:
                joints[k] = name
        return joints

    @cached_property
    def euclidean(self) -> bool:
        """Whether q_dot is v."""
        return not (self._quaternions or self._cosines)

    def q_dot(self, q: Array, v: Array) -> Array:
        """q_dot, shape (nq,), from the rates v of the tree, shape (nv,)."""
        if self.euclidean:
            return v
        q_dot = np.empty(self._model.nq)
        in_q, in_v = self.plain
        q_dot[in_q] = v[in_v]
        for i, k in self._quaternions:
            # The rate of a quaternion is its product with the quaternion (omega / 2, 0), where
            # omega is the angular velocity in axes of the body.
            x, y, z, w = q[i : i + 4]
            a, b, c = v[k : k + 3] / 2
            q_dot[i : i + 4] = (
                w * a + y * c - z * b,
                w * b + z * a - x * c,
                w * c + x * b - y * a,
                -x * a - y * b - z * c,
            )
        for i, k in self._cosines:
            q_dot[i : i + 2] = -q[i + 1] * v[k], q[i] * v[k]
        for i, k in self._free_positions:
            R = pin.Quaternion(q[i + 3 : i + 7]).matrix()
            q_dot[i : i + 3] = R @ v[k : k + 3]
        for i, k in self._plane_positions:
            c, s = q[i + 2 : i + 4]
            q_dot[i : i + 2] = c * v[k] - s * v[k + 1], s * v[k] + c * v[k + 1]
        return q_dot

    def normalised(self, q: Array) -> Array:
        """q with unit vectors of length one, shape (nq,)."""
        if self.euclidean:
            return q
        q = q.copy()
        for size, starts in ((4, self._quaternions), (2, self._cosines)):
            for i, _ in starts:
                length = np.linalg.norm(q[i : i + size])
                if length == 0:
                    kind = "quaternion" if size == 4 else "cosine-sine pair"
                    raise InputError(
                        "q", f"the {kind} at {i} is zero; start from pinocchio.neutral(model)"
                    )
                q[i : i + size] /= length
        return q

    def without_jumps(self, q: Array) -> Array:
        """Consecutive configurations, (N, nq), with unwrapped angles and continuous quaternions."""
        q = q.copy()
        angles = [unit == "rad" for unit in self.position_units]
        q[:, angles] = np.unwrap(q[:, angles], axis=0)
        for i, _ in self._quaternions:
            q[:, i : i + 4] = without_sign_changes(q[:, i : i + 4])
        return q

    def on_manifold(self, q: Array) -> Flags:
        """Whether the unit vectors have length one, shape (...), for q of shape (..., nq)."""
        return np.all(self._length_errors(q) < _LENGTH_ERROR, axis=-1)

    def require_on_manifold(self, q: Array, name: str = "q") -> None:
        """Check that the unit vectors of q, shape (nq,), have length one."""
        if self.euclidean:
            return
        # A fast check for control loops. If |l^2 - 1| < 1e-6 for a length l, |l - 1| is less.
        with np.errstate(over="ignore"):
            errors_of_squares = (q * q).dot(self._in_unit_vectors) - 1
            is_near = errors_of_squares.dot(errors_of_squares) < _LENGTH_ERROR**2
        if is_near:
            return
        if not self.on_manifold(q):
            off = float(self._length_errors(finite_array(name, q, q.shape)).max())
            raise InputError(
                name,
                f"the length of a quaternion or cosine-sine pair differs from 1 by {off:.3g}; "
                "pinocchio.normalize corrects it",
            )

    def _length_errors(self, q: Array) -> Array:
        """How far the length of each unit vector is from 1, shape (..., unit vectors)."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.abs(np.sqrt((q * q).dot(self._in_unit_vectors)) - 1)

    @cached_property
    def _in_unit_vectors(self) -> Array:
        """1 where an entry of q belongs to a unit vector, else 0, shape (nq, unit vectors).

        So (q * q) @ this are the squared lengths of the unit vectors.
        """
        sizes = [(i, 4) for i, _ in self._quaternions] + [(i, 2) for i, _ in self._cosines]
        entries = np.zeros((self._model.nq, len(sizes)))
        for vector, (i, size) in enumerate(sizes):
            entries[i : i + size, vector] = 1
        return entries

    @cached_property
    def plain(self) -> tuple[Indices, Indices]:
        """Indices in q and in v of the entries with q_dot = v, both of one length."""
        q = np.ones(self._model.nq, dtype=bool)
        v = np.ones(self._model.nv, dtype=bool)
        for i, k in self._quaternions:
            q[i : i + 4] = False
            v[k : k + 3] = False
        for i, k in self._cosines:
            q[i : i + 2] = False
            v[k] = False
        for i, k in self._free_positions:
            q[i : i + 3] = False
            v[k : k + 3] = False
        for i, k in self._plane_positions:
            q[i : i + 2] = False
            v[k : k + 2] = False
        return np.flatnonzero(q), np.flatnonzero(v)


def without_sign_changes(quaternions: Array) -> Array:
    """Consecutive quaternions, shape (N, 4), each with the sign that is nearer to the one before.

    A quaternion and its negative are the same rotation.
    """
    products = (quaternions[1:] * quaternions[:-1]).sum(axis=1)
    relative_signs = np.where(products < 0, -1, 1)  # of each to the one before
    result = quaternions.copy()
    result[1:] *= np.cumprod(relative_signs)[:, None]
    return result
