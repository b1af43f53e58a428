# SPDX-License-Identifier: BSD-2-Clause
"""Generalized forces as f = Y theta, with the parameters theta of bodies, joints, lines and motors.

Y = L^T Y_tree. A column of Y_tree has the forces along the rates of the tree for one unit of a
parameter. References of springs and rest lengths of lines are constant, so f is linear in theta.

`names_of` and `parameters_of` list the parameters, `torque_regressor` computes Y, and `changed`
makes a mechanism's tree and numbers with other parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number, read_only, single_array
from ..errors import DescriptionWarning, InputError, UnknownNameError, warn_caller
from ..model.dry_friction import sign_of
from ..model.lines import LineForce
from ..model.mechanism import Friction, Mechanism, Springs
from ..summaries import Summary, listed
from .dynamics import Context

#: Parameters of a body about the frame of its joint, as in `pin.Inertia.toDynamicParameters`.
OF_BODY = ("mass", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")
#: Parameters of the rates. In theta, those of all rates stand together: all viscous, then all
#: coulomb, and so on. Only rates for which a spring is possible have a stiffness.
OF_RATE = ("viscous", "coulomb", "armature", "stiffness", "offset")
#: Parameters of a line, and the names of these attributes of `LineForce`.
OF_LINE = {
    "stiffness": "stiffness",
    "damping": "damping",
    "preload": "preload",
    "mass": "mass",
    "coulomb": "coulomb_friction",
}


@dataclass(frozen=True, repr=False, eq=False)
class DynamicParameters(Summary):
    """The parameters in which generalized forces are linear, f = Y theta, with their names.

    It is an array for NumPy: `Y @ parameters` and `np.asarray(parameters)` work.

    Attributes:
        names: For each body the name of its joint with .mass, .mx, .my, .mz [kg m] and
            .ixx, .ixy, .iyy, .ixz, .iyz, .izz [kg m^2], about the joint's frame; then for each rate
            .viscous, .coulomb, .armature, .stiffness (where a spring is possible) and .offset, a
            constant force [N m] or [N]; for each line .stiffness, .damping, .preload, .mass,
            .coulomb; for each motor .torque_offset, by which measured torques are too large.
        values: Their values, shape (p,), read-only, SI units.

    Example:
        >>> theta = chain.dynamic_parameters
        >>> theta["crank.mass"] == chain.model.inertias[1].mass
        True
    """

    names: tuple[str, ...]
    values: Array

    def __array__(self, dtype: object = None, copy: bool | None = None) -> Array:
        return np.array(self.values, dtype=dtype)  # type: ignore[call-overload]

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, name: str) -> float:
        if name not in self.names:
            raise UnknownNameError("parameter", name, list(self.names))
        return float(self.values[self.names.index(name)])

    def scale_mass(self, body: str, factor: float) -> DynamicParameters:
        """The parameters with mass, first moment and inertia of a body times a factor.

        The mass centre stays. `body` is the name of its joint. Use `with_parameters` to apply them.

        Raises:
            UnknownNameError: If there is no such body.
            InputError: If the factor is negative or not finite.

        Example:
            >>> loaded = chain.with_parameters(chain.dynamic_parameters.scale_mass("crank", 2.0))
            >>> (loaded.model.inertias[1].lever == chain.model.inertias[1].lever).all()
            np.True_
        """
        bodies = [name.removesuffix(".mx") for name in self.names if name.endswith(".mx")]
        if body not in bodies:
            raise UnknownNameError("body", body, bodies)
        values = self.values.copy()
        first = self.names.index(f"{body}.mass")
        values[first : first + len(OF_BODY)] *= positive_number("factor", factor, or_zero=True)
        return replace(self, values=read_only(values))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """The parameters that are not zero."""
        pairs = zip(self.names, self.values, strict=True)
        rows = [(name, f"{value:.6g}") for name, value in pairs if value]
        return f"DynamicParameters, {len(self)}, those that are not zero", rows


def with_springs(mechanism: Mechanism) -> Mechanism:
    """The mechanism with a spring of stiffness 1 at all rates for which one is possible.

    Kernels of this mechanism have the stiffnesses of all these rates as parameters.
    """
    stiffness = np.zeros(mechanism.model.nv)
    stiffness[mechanism.possible_springs] = 1
    return replace(mechanism, springs=Springs(stiffness, mechanism.springs.reference))


def names_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of all parameters, in the order of the columns."""
    names: list[str] = []
    for body in list(mechanism.model.names)[1:]:
        names += [f"{body}.{word}" for word in OF_BODY]
    for word in OF_RATE:
        rates = mechanism.possible_springs if word == "stiffness" else range(mechanism.model.nv)
        names += [f"{mechanism.space.rate_names[k]}.{word}" for k in rates]
    for line in mechanism.lines.forces:
        names += [f"{line}.{word}" for word in OF_LINE]
    names += [f"{motor}.torque_offset" for motor in mechanism.motor_names]
    return tuple(names)


class _Blocks(NamedTuple):
    """The values of all parameters by kinds, in the order of `names_of`.

    There are r bodies and nv rates. Springs are possible for `mechanism.possible_springs` of them.
    """

    bodies: Array  #: Shape (r, 10).
    viscous: Array  #: Shape (nv,).
    coulomb: Array  #: Shape (nv,).
    armature: Array  #: Shape (nv,).
    stiffness: Array  #: Shape (rates with springs,).
    offset: Array  #: Shape (nv,).
    lines: Array  #: Shape (lines, 5), as `OF_LINE`.
    torque_offsets: Array  #: Shape (motors,).

    @property
    def values(self) -> Array:
        """All values, shape (p,)."""
        return np.concatenate([block.ravel() for block in self])

    @classmethod
    def of_values(cls, mechanism: Mechanism, values: Array) -> _Blocks:
        """The blocks from all values, shape (p,)."""
        shapes = [block.shape for block in _blocks_of(mechanism)]
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        parts = np.split(values, ends[:-1])
        return cls(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))


def _blocks_of(mechanism: Mechanism) -> _Blocks:
    """The parameters of a mechanism; its offsets are zero."""
    model = mechanism.model
    lines = mechanism.lines
    return _Blocks(
        bodies=np.array([body.toDynamicParameters() for body in list(model.inertias)[1:]]),
        viscous=mechanism.friction.viscous,
        coulomb=mechanism.friction.coulomb,
        armature=model.armature,
        stiffness=mechanism.springs.stiffness[mechanism.possible_springs],
        offset=np.zeros(model.nv),
        lines=np.transpose(
            [lines.stiffness, lines.damping, lines.preload, lines.masses, lines.coulomb]
        ),
        torque_offsets=np.zeros(len(mechanism.motor_names)),
    )


def parameters_of(mechanism: Mechanism) -> DynamicParameters:
    """The parameters of a mechanism; its offsets are zero."""
    return DynamicParameters(names_of(mechanism), read_only(_blocks_of(mechanism).values))


def size_of(mechanism: Mechanism) -> int:
    """How many parameters there are."""
    bodies = mechanism.model.njoints - 1
    rates = mechanism.model.nv
    lines = len(OF_LINE) * len(mechanism.lines.forces)
    motors = len(mechanism.motor_names)
    return 10 * bodies + 4 * rates + len(mechanism.possible_springs) + lines + motors


def torque_regressor(context: Context, q: Array, va: Array, aa: Array) -> Array:
    """Y = L^T Y_tree, shape (n, p), columns in the order of `names_of`."""
    mechanism = context.mechanism
    v, v_dot = context.complement.motion(q, va, aa)
    L = context.complement.L  # at q, by `motion`
    # A parameter p of rate k gives the force p x_k, on this rate alone. Its column is column k of
    # L^T diag(x), which is L.T * x. For viscous friction x = v, for rotors x = v_dot, and so on.
    viscous = L.T * v
    unit_friction = Friction(np.zeros(len(v)), np.ones(len(v)), mechanism.friction.sign_width)
    coulomb = L.T * -unit_friction.forces(v)
    armature = L.T * v_dot
    deflections = pin.difference(mechanism.model, mechanism.springs.reference, q)
    stiffness = (L.T * deflections)[:, mechanism.possible_springs]
    offset = L.T
    lines = _of_lines(context, q, v, v_dot)
    torque_offsets = L.T.dot(context.actuation(q))
    bodies = _of_bodies(context, v, v_dot)
    return np.hstack([bodies, viscous, coulomb, armature, stiffness, offset, lines, torque_offsets])


def _of_lines(context: Context, q: Array, v: Array, v_dot: Array) -> Array:
    """Columns of the lines, shape (n, 5 lines): L^T J^T times the tension by a unit parameter."""
    lines = context.mechanism.lines
    lengths, J = context.lines.evaluate(q)
    rates = J.dot(v)
    taut = lines.taut(lengths, rates)  # 0 for slack cables, else 1
    tensions = {
        "stiffness": taut * (lengths - lines.rest_lengths),
        "damping": taut * rates,
        "preload": taut,
        "mass": context.lines.accelerations(q, v, v_dot),
        "coulomb": sign_of(rates, context.mechanism.friction.sign_width),
    }
    L_J = J.dot(context.complement.L).T
    columns = [L_J * tensions[word] for word in OF_LINE]  # each (n, lines)
    # The five parameters of a line stand together.
    return np.stack(columns, axis=-1).reshape(len(L_J), len(OF_LINE) * len(rates))


def _of_bodies(context: Context, v: Array, v_dot: Array) -> Array:
    """Columns of the bodies, shape (n, 10 r)."""
    tree = context.tree  # the normal tree of Pinocchio's functions; its rates are S v
    S = tree.S
    L = context.complement.L
    n = L.shape[1]
    Y_tree = pin.computeJointTorqueRegressor(
        tree.model, context.data, context.loops.q, S.dot(v), S.dot(v_dot)
    )
    Y_tree = Y_tree.reshape(tree.model.nv, -1)  # Pinocchio gives a vector for one rate
    by_body = S.dot(L).T.dot(Y_tree).reshape(n, tree.model.njoints - 1, len(OF_BODY))
    weight_shares = context.mechanism.weight_shares
    if weight_shares is not None:
        # Y_tree has the whole weight of each body, but on some bodies only a share of it acts. The
        # forces of the remaining part, which are forces at rest, are subtracted. Mass and first
        # moment of this part are linear in those of the body.
        at_rest = np.zeros(tree.model.nv)
        Y_weights = pin.computeJointTorqueRegressor(
            tree.model, context.data, context.loops.q, at_rest, at_rest
        )
        Y_weights = Y_weights.reshape(tree.model.nv, -1)
        of_weights = S.dot(L).T.dot(Y_weights).reshape(by_body.shape)
        for body in weight_shares.bodies:
            k = tree.bodies[body + 1] - 1
            by_body[:, k, :4] -= of_weights[:, k, :4].dot(weight_shares.weightless_factor(body))
    order = np.array(tree.bodies[1:]) - 1  # the robot's bodies among those of the normal tree
    return by_body[:, order].reshape(n, len(order) * len(OF_BODY))


def changed(
    mechanism: Mechanism, theta: ArrayLike | Mapping[str, float]
) -> tuple[pin.Model, dict[str, ArrayLike | None], tuple[LineForce, ...]]:
    """A mechanism's data with parameters theta, to make a new one.

    Args:
        mechanism: The present mechanism.
        theta: All parameters, shape (p,), or some by name.

    Returns:
        model: The tree with bodies, friction and rotors of theta.
        numbers: The argument `numbers` of `mechanism_of`.
        forces: The lines.

    Raises:
        InputError: For parameters that a chain cannot have.
    """
    model = pin.Model(mechanism.model)
    blocks = _Blocks.of_values(mechanism, _values(mechanism, theta))
    if blocks.torque_offsets.any():
        raise InputError(
            "theta", "a chain has no torque offsets of motors; subtract them from the torques"
        )
    for i, parameters in enumerate(blocks.bodies, 1):  # joint 0 is the base
        model.inertias[i] = _inertia(model.names[i], model.inertias[i], parameters)
    model.damping = blocks.viscous
    model.friction = blocks.coulomb
    model.armature = blocks.armature
    stiffness = np.zeros(model.nv)
    stiffness[mechanism.possible_springs] = blocks.stiffness
    reference = _spring_reference(mechanism, stiffness, blocks.offset)
    at_neutral = np.array_equal(reference, pin.neutral(model))
    numbers: dict[str, ArrayLike | None] = {
        "viscous_friction": None,  # those of the model
        "coulomb_friction": None,
        "stiffness": read_only(stiffness) if stiffness.any() else None,
        "spring_reference": None if at_neutral else read_only(reference),
    }
    forces = tuple(
        replace(line, **dict(zip(OF_LINE.values(), of_line, strict=True)))
        for line, of_line in zip(mechanism.lines.forces, blocks.lines, strict=True)
    )
    return model, numbers, forces


def _values(mechanism: Mechanism, theta: ArrayLike | Mapping[str, float]) -> Array:
    """The values of all parameters; theta has all of them, or some by name."""
    now = parameters_of(mechanism)
    if not isinstance(theta, Mapping):
        return single_array("theta", theta, now.values.shape)
    values = now.values.copy()
    for name, value in theta.items():
        now[name]  # raises the error for an unknown name
        values[now.names.index(name)] = single_array(name, value, ())
    _warn_of_masses(now, theta)
    return values


def _spring_reference(mechanism: Mechanism, stiffness: Array, offset: Array) -> Array:
    """The reference of springs that also give the constant forces `offset`, shape (nq,).

    Against a spring, a motion needs the force stiffness (q - reference). It needs `offset` more if
    the reference is shifted by -offset / stiffness.
    """
    names = mechanism.space.rate_names
    reference = mechanism.springs.reference
    without_spring = [names[k] for k in np.flatnonzero((offset != 0) & (stiffness == 0))]
    if without_spring:
        text = f"offset of {listed(without_spring)}: a chain has offsets only of springs with "
        raise InputError("theta", text + "stiffness")
    in_balls: list[str] = []
    for joint in mechanism.model.joints:
        if joint.shortname() == "JointModelSpherical":
            rates = range(joint.idx_v, joint.idx_v + 3)
            in_balls += [names[k] for k in rates if offset[k]]
    if in_balls:
        raise InputError(
            "theta", f"offset of {listed(in_balls)}: in a ball it depends on where its spring is"
        )
    if not offset.any():
        return reference
    shift = np.divide(offset, stiffness, out=np.zeros(len(offset)), where=stiffness != 0)
    return np.asarray(pin.integrate(mechanism.model, reference, -shift))


def _warn_of_masses(now: DynamicParameters, theta: Mapping[str, float]) -> None:
    """Warn if only the mass of a body changes, but not its first moment and inertia."""
    for name, mass in theta.items():
        body, _, word = name.rpartition(".")
        others = [f"{body}.{other}" for other in OF_BODY[1:]]
        if word != "mass" or others[0] not in now.names:
            continue  # no body: a line has a mass too
        only = mass != now[name] and not theta.keys() & set(others)
        if only and now[name] and any(now[other] for other in others):
            factor = mass / now[name]
            warn_caller(
                f"{name}: the first moment and the inertia of the body stay as they are; "
                f"with_parameters(chain.dynamic_parameters.scale_mass({body!r}, {factor:.9g})) "
                "scales all of them",
                DescriptionWarning,
            )


def _inertia(name: str, present: pin.Inertia, parameters: Array) -> pin.Inertia:
    """A body's inertia with the parameters `OF_BODY`; without mass its mass centre stays."""
    if np.array_equal(present.toDynamicParameters(), parameters):
        return present
    mass = parameters[0]
    if mass:
        return pin.Inertia.FromDynamicParameters(parameters)
    if parameters[1:4].any():
        raise InputError("theta", f"body {name} has a first moment but no mass")
    xx, xy, yy, xz, yz, zz = parameters[4:]
    return pin.Inertia(0.0, present.lever, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
