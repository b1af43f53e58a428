# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the torques with every installed referee: `sst-pin verify`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..chain.closed_chain import ClosedChain
from ..description.parameters import Parameters
from ..errors import ClosureError, MissingExtraError
from ..motion.energy import energy_error
from ..sst import paper
from ..sst.platform_motion import paper_circle
from ..sst.robot import SST
from . import referees
from .comparisons import Comparison, Judge
from .referees import lagrange
from .sampling import random_parameters, random_state
from .verify_in_time import verify_in_time


def verify_sst(quick: bool = False) -> Iterator[Comparison]:
    """Every installed referee on example 1, on random states and on random SSTs.

    `quick` takes fewer cases, and none that step in time.
    """
    count = 5 if quick else 40
    t = np.linspace(0, paper.PERIOD, 13 if quick else 101)
    circle = list(zip(*paper_circle(t), strict=True))
    yield from _instants("example 1", [(Parameters(), [(*state, None) for state in circle])])
    rng = np.random.default_rng(0)
    states = [_loaded(SST(), rng) for _ in range(count)]
    yield from _instants("the paper's robot, loads", [(Parameters(), states)])
    for friction, name in ((False, "random SSTs, loads"), (True, "random SSTs, friction, loads")):
        robots = [random_parameters(rng, friction) for _ in range(count)]
        cases = [(p, [_loaded(SST(p), rng) for _ in range(3)]) for p in robots]
        yield from _instants(name, cases)
    yield from _accelerations([random_parameters(rng) for _ in range(count)], rng)
    yield _energy(SST(), 201)
    if not quick:
        yield from verify_in_time()


def skipped() -> list[MissingExtraError]:
    """Missing packages of referees, and how to install them."""
    return referees.all_referees(Parameters())[1]


def verify_chain(chain: ClosedChain, count: int = 20) -> Iterator[Comparison]:
    """Lagrange multipliers on any closed chain, at random configurations in random motion.

    Raises:
        ClosureError: When the chain cannot be assembled.
    """
    rng = np.random.default_rng(0)
    name, of = lagrange.LagrangeMultipliers.name, chain.mechanism.model.name or "chain"
    forces = Judge(name, f"forces along the coordinates, {of}")
    torques, back = Judge(name, f"torques, {of}"), Judge(name, f"accelerations, {of}")
    sufficient = chain.mobility().sufficient
    for q, va, aa in _chain_states(chain, count, rng):
        ours = chain.generalized_forces(q, va, aa)
        forces.hold(partial(lagrange.generalized_forces, chain, q, va, aa), ours)
        tau = rng.normal(size=len(chain.motor_names))
        if sufficient:
            tau = chain.compute_torques(q, va, aa)
            torques.hold(partial(lagrange.torques, chain, q, va, aa), tau)
        ours = chain.compute_accelerations(q, va, tau)
        back.hold(partial(lagrange.accelerations, chain, q, va, tau), ours)
    yield from (judge.verdict() for judge in (torques, forces, back) if judge.cases)


def _chain_states(
    chain: ClosedChain, count: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array, Array]]:
    """Assembled configurations away from singularities, with a motion of the coordinates."""
    start, model = chain.generic_configuration(), chain.mechanism.model
    n, limit = chain.degrees_of_freedom, max(1e3, float(chain.condition_number(start)))
    found, tries = 0, 0
    while found < count:
        tries += 1
        if tries > 100 * count:
            raise ClosureError("no configurations away from singularities were found", np.inf)
        try:
            q = chain.assemble(
                pin.integrate(model, start, rng.normal(scale=0.3, size=model.nv)), fixed=()
            )
        except ClosureError:
            continue
        if chain.condition_number(q) < limit:
            found += 1
            yield q, rng.normal(size=n), rng.normal(size=n)


State = tuple[Array, Array, Array, Array | None]


def _loaded(robot: SST, rng: np.random.Generator) -> State:
    return (*random_state(robot, rng), rng.normal(scale=5, size=3))


def _instants(
    name: str, cases: Sequence[tuple[Parameters, Sequence[State]]]
) -> Iterator[Comparison]:
    """Inverse dynamics of every referee."""
    judges: dict[str, Judge] = {}
    for parameters, states in cases:
        robot, reference = SST(parameters), SST(parameters, kernels=False)
        asked = referees.all_referees(parameters)[0]
        for R, omega, alpha, moment in states:
            motion = robot.joint_motion(R, omega, alpha)
            tau = robot.compute_torques(*motion, platform_moment=moment)
            own = partial(reference.compute_torques, *motion, platform_moment=moment)
            answers = {r.name: partial(r.torques, R, omega, alpha, moment) for r in asked}
            for who, answer in ({"reference path": own} | answers).items():
                judges.setdefault(who, Judge(who, f"torques, {name}")).hold(answer, tau)
    for judge in judges.values():
        yield judge.verdict()


def _accelerations(robots: Sequence[Parameters], rng: np.random.Generator) -> Iterator[Comparison]:
    """Direct dynamics of those referees that have one."""
    judges: dict[str, Judge] = {}
    what = "accelerations, random SSTs, friction"
    for parameters in robots:
        robot = SST(parameters)
        R, omega, alpha = random_state(robot, rng)
        q, va, aa = robot.joint_motion(R, omega, alpha)
        tau = robot.compute_torques(q, va, aa)
        answers = {
            referee.name: (partial(referee.accelerations, R, omega, tau), alpha)
            for referee in referees.all_referees(parameters)[0]
            if isinstance(referee, referees.DirectReferee)
        }
        back = robot.compute_accelerations(q, va, tau)
        multipliers = partial(lagrange.accelerations, robot, q, va, tau)
        answers[lagrange.LagrangeMultipliers.name] = multipliers, back
        for who, (answer, ours) in answers.items():
            judges.setdefault(who, Judge(who, what)).hold(answer, ours)
    for judge in judges.values():
        yield judge.verdict()


def _energy(robot: SST, samples: int) -> Comparison:
    """Work of the motors against kinetic and potential energy along example 1."""
    judge = Judge("energy", "work of the motors, example 1", 1e-8)  # quadrature of the power
    motion = paper.example_1(robot, np.linspace(0, paper.PERIOD, samples))
    work = robot.kinetic_energy(motion.q, motion.va) + robot.potential_energy(motion.q)
    judge.hold(lambda: energy_error(robot, motion) + work, work)
    return judge.verdict()
