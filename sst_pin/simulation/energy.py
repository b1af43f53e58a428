# SPDX-License-Identifier: BSD-2-Clause
"""Energies, their powers, and the energy balance of a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, for_each_sample
from ..engine import Engine, Robot, require_robot
from ..errors import InputError
from .samples import spline
from .trajectories import Trajectory, require_motion


class EnergyBalance(NamedTuple):
    """Energies along a motion since its start, where all are zero, each of shape (N,), [J].

    Attributes:
        kinetic: Kinetic energy of all bodies.
        potential: Potential energy of gravity, the springs and the forces along lines.
        motors: Work of the motors.
        friction: Work of friction in all joints and of dampers along lines, negative or zero.
    """

    kinetic: Array
    potential: Array
    motors: Array
    friction: Array

    @property
    def error(self) -> Array:
        """Change of energy minus work; zero for an exact motion."""
        return self.kinetic + self.potential - self.motors - self.friction


def motor_rates(engine: Engine, q: ArrayLike, va: ArrayLike) -> Array:
    """Rates of the motors, shape (..., motors)."""
    mechanism = engine.mechanism
    v = engine.joint_rates(q, va)
    return np.asarray(v @ mechanism.actuation + engine.line_rates(q, v) @ mechanism.lines.actuation)


def motor_powers(engine: Engine, motion: Trajectory) -> Array:
    """Power of each motor along a motion, shape (N, motors), [W]."""
    return motion.tau * motor_rates(engine, motion.q, motion.va)


def kinetic_energy(engine: Engine, q: ArrayLike, va: ArrayLike) -> Array:
    """Kinetic energy, shape (...), [J]."""
    arrays = [engine.loops.configurations(q), engine.joint_rates(q, va)]
    return for_each_sample(engine.reference.kinetic_energy, arrays, (1, 1), ())


def potential_energy(engine: Engine, q: ArrayLike) -> Array:
    """Potential energy of gravity, springs and lines, shape (...), [J]."""
    array = finite_array("q", q, (engine.mechanism.model.nq,))
    return for_each_sample(engine.reference.potential_energy, (array,), (1,), ())


def friction_power(engine: Engine, q: ArrayLike, va: ArrayLike) -> Array:
    """Power of friction in all joints, Eq. (87), and along lines, shape (...), [W]."""
    mechanism = engine.mechanism
    lines = mechanism.lines
    v = engine.joint_rates(q, va)
    on_joints = (mechanism.friction.forces(v) * v).sum(axis=-1)
    rates = engine.line_rates(q, v)
    lengths = engine.line_lengths(q)
    # The potential energy contains the work of the springs of lines. Friction is the rest of the
    # tension. The rest is not the damper's force alone: a damper can make a cable slack whose
    # spring pulls, or taut although its spring does not pull.
    tensions = lines.tensions(lengths, rates, mechanism.friction.sign_width)
    of_springs = lines.tensions(lengths, np.zeros_like(rates), 0.0)
    on_lines = -((tensions - of_springs) * rates).sum(axis=-1)
    return finite_array("power", on_joints + on_lines, ())


def energy_balance(engine: Engine, motion: Trajectory) -> EnergyBalance:
    """Energies of a motion and the work of motors and friction, without external loads.

    Powers are integrated with splines through the samples.
    """
    require_motion(motion, engine.mechanism)
    if len(motion) < 2:
        raise InputError("motion", "has one sample; at least two are needed")

    def work(power: Array) -> Array:
        return np.asarray(spline(motion.t, power).antiderivative()(motion.t))

    kinetic = kinetic_energy(engine, motion.q, motion.va)
    potential = potential_energy(engine, motion.q)
    return EnergyBalance(
        kinetic - kinetic[0],
        potential - potential[0],
        work(motor_powers(engine, motion).sum(axis=1)),
        work(friction_power(engine, motion.q, motion.va)),
    )


def energy_error(chain: Robot, motion: Trajectory) -> Array:
    """Change of a motion's energy minus the work done on it, shape (N,), [J].

    Args:
        chain: The robot.
        motion: A motion of this robot, with at least two samples.

    Raises:
        InputError: For another motion.
        ClosureError: When its loops are open.

    Example:
        >>> motion = chain.simulate([0], chain.home, [0], np.linspace(0, 0.2, 101))
        >>> bool(abs(sst_pin.energy_error(chain, motion)).max() < 1e-8)
        True
    """
    require_robot("chain", chain)
    return energy_balance(chain.engine, motion).error
