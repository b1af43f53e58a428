# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics in time: Eqs. (7) and (92) as a state space in q and va (Sect. 6.2).

`simulate` checks the arguments of `ClosedChain.simulate`; `Integration` integrates the motion.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number, single_array
from ..engine import Engine
from ..errors import InputError, SingularConfigurationError, SingularityWarning, warn_caller
from ..model.closures import Rolling
from ..progress import FASTER, Bar
from ..states import StateSpace
from .inputs import ExternalLoad, Torque, WrenchLoad, load_input, torque_input
from .integration import Integration
from .rollouts import require_smooth
from .sampled_torques import SampledTorque
from .samples import sample_times
from .settings import Settings
from .state_equations import StateEquations
from .trajectories import Trajectory, trajectory_of

_HINT = f"simulate is on the slow reference path; {FASTER}"
_BAR = "{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} s of motion"


def simulate(
    engine: Engine,
    torque: Torque,
    q0: ArrayLike,
    va0: ArrayLike,
    t: ArrayLike,
    *,
    platform_moment: ExternalLoad,
    external_wrenches: WrenchLoad,
    sign_width: float,
    settings: Settings,
) -> Trajectory:
    """The motion that `ClosedChain.simulate` returns, for the same arguments."""
    times = sample_times(t, 2)
    mechanism = engine.mechanism
    require_smooth(mechanism)
    positive_number("sign_width", sign_width, or_zero=True)  # 0 is the sign itself
    if isinstance(torque, SampledTorque) and settings.through_singularities:
        raise InputError("through_singularities", "not with sampled torques, which are not smooth")
    space = engine.state_space(sign_width)
    start = _start(engine, space, q0, va0, settings.max_condition_number)
    # By default, a step is at most the spacing of t where a torque or load is a function.
    by_spacing = settings.max_step is None
    load = load_input(engine, platform_moment, external_wrenches, times, by_spacing=by_spacing)
    torques = torque_input(mechanism, torque, times, by_spacing=by_spacing)
    equations = StateEquations(space, torques, load)
    # The derivatives of a load function and of rolling wheels are not computed.
    load_is_constant = load is None or not load.is_function
    rolls = any(isinstance(closure, Rolling) for closure in mechanism.closures)
    exact = sign_width > 0 and load_is_constant and not rolls
    hint = ""
    if engine.make_kernels is None:
        hint = _HINT
    duration = float(times[-1] - times[0])
    with closing(Bar(hint, desc="simulating", total=duration, bar_format=_BAR)) as bar:
        if settings.progress is None:
            settings = replace(settings, progress=lambda time: bar.reach(time - times[0]))
        integration = Integration(equations, mechanism, times, settings, exact=exact)
        samples = integration.integrate(start)
    if integration.stopped:
        warn_caller(integration.stopped, SingularityWarning)
    if integration.missed:
        warn_caller(integration.missed, RuntimeWarning)
    return trajectory_of(
        mechanism,
        times[: len(samples.q)],
        samples.q,
        samples.va,
        samples.aa,
        samples.tau,
        integration.stopped,
        integration.crossings,
    )


def _start(
    engine: Engine, space: StateSpace, q0: ArrayLike, va0: ArrayLike, max_condition_number: float
) -> Array:
    """The first state (q, va), shape (nq + n,); errors name the arguments."""
    mechanism = engine.mechanism
    n = len(mechanism.coordinates)
    q = single_array("q0", q0, (mechanism.model.nq,))
    va = single_array("va0", va0, (n,))
    at_rest = not va.any()
    try:
        engine.joint_rates(q, np.zeros(n))  # refuses open loops, and singular coordinates
        condition = space.condition_number(q)
    except SingularConfigurationError:
        if not at_rest:  # the rates of these coordinates do not determine the motion
            raise
        condition = np.inf
    if at_rest and not condition < max_condition_number:
        # The rates of other coordinates are zero too, so the motion can start in them.
        _, condition = space.in_good_coordinates(q)
    if not condition < max_condition_number:
        raise InputError("q0", f"closer to a singularity than {max_condition_number=:g}")
    return np.concatenate([q, va])
