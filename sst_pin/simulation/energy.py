# SPDX-License-Identifier: BSD-2-Clause
"""Where the energy of a motion comes from and where it goes."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError
from .moving_robot import require_motion
from .samples import spline
from .trajectories import Trajectory

if TYPE_CHECKING:
    from ..closed_chain import ClosedChain


class EnergyBalance(NamedTuple):
    """Energies along a motion since its start, where all are zero, each of shape (N,), [J].

    Attributes:
        kinetic: Kinetic energy of all bodies.
        potential: Potential energy of the weights, the springs and the forces along lines.
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


def motor_powers(chain: ClosedChain, motion: Trajectory) -> Array:
    """Power of each motor along a motion of the chain, shape (N, motors), [W]."""
    return motion.tau * chain.motor_rates(motion.q, motion.va)


def energy_balance(chain: ClosedChain, motion: Trajectory) -> EnergyBalance:
    """Energies of a motion and the work of motors and friction, without external loads.

    Powers are integrated with splines through the samples.
    """
    chain = copy(chain)
    require_motion(motion, chain.mechanism)
    if len(motion) < 2:
        raise InputError("motion", "has one sample; at least two are needed")

    def work(power: Array) -> Array:
        return np.asarray(spline(motion.t, power).antiderivative()(motion.t))

    kinetic = chain.kinetic_energy(motion.q, motion.va)
    potential = chain.potential_energy(motion.q)
    return EnergyBalance(
        kinetic - kinetic[0],
        potential - potential[0],
        work(motor_powers(chain, motion).sum(axis=1)),
        work(chain.friction_power(motion.q, motion.va)),
    )


def energy_error(chain: ClosedChain, motion: Trajectory) -> Array:
    """How far a motion's energy is from the work done on it, shape (N,), [J].

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
    return energy_balance(chain, motion).error
