# SPDX-License-Identifier: BSD-2-Clause
"""Nonsmooth steps of Warp are those of the reference path, and say where they are not."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import Contact, InputError, LineForce, Rope, robots
from sst_pin.errors import CompilationError
from tests.gallery.on_feet import biped
from tests.gallery.touching import frame, tree

wp = pytest.importorskip("warp", reason="needs the extra 'gpu'")

from sst_pin.compiled.warp_batch import Status  # noqa: E402

#: Largest residual of complementarity of a solved step, relative to the impulses.
FORCES = ("joint_forces", "line_friction")
SOLVED = {"float64": 1e-9, "float32": 1e-5}


def arrays(batch, *values):
    return [wp.array(x, dtype=batch.dtype, device=batch.device) for x in values]


def steps(batch, q, va, tau, h, **options):
    """States and statuses after each of some steps with torques of shape (N, steps, motors)."""
    state = arrays(batch, q, va)
    states, codes = [], []
    for k in range(tau.shape[1]):
        status = wp.full(len(q), 9, dtype=wp.int32, device=batch.device)
        (torque,) = arrays(batch, tau[:, k])
        state = batch.step(state, torque, h, nonsmooth=True, status=status, **options)
        states.append(state)
        codes.append(status.numpy())
    return states, np.transpose(codes)


def series(states, name):
    """A field of all states, shape (N, steps, ...)."""
    return np.stack([getattr(state, name).numpy() for state in states], axis=1)


def require_same(states, motion, h, dtype):
    """Each step may be off by what the solver leaves, relative to the rates."""
    count = len(states)
    largest = np.abs(motion.va).max()
    error = count * SOLVED[dtype] * largest
    assert np.abs(series(states, "va") - motion.va[:, 1:]).max() < error
    q = series(states, "q")
    rounding = count * np.finfo(dtype).eps * np.abs(motion.q).max()
    assert np.abs(q - motion.q[:, 1:]).max() < count * h * error + rounding


@pytest.fixture(scope="module")
def tripod():
    """A body that bounces on three feet, on a slope of 0.2 rad: friction of 0.5 holds it.

    With three feet, the forces of sliding feet are unique, and so is the motion.
    """
    model = tree(("body", pin.JointModelFreeFlyer(), 2.0, 0.02))
    R = pin.utils.rotate("y", 0.2)
    frame(model, "slope", "universe", (0, 0, 0), R)
    for k, angle in enumerate(2 * np.pi / 3 * np.arange(3)):
        frame(model, f"foot_{k}", "body", (0.15 * np.cos(angle), 0.15 * np.sin(angle), -0.05))
    feet = [Contact(f"foot_{k}", friction=0.5, restitution=0.2, ground="slope") for k in range(3)]
    place = pin.SE3ToXYZQUAT(pin.SE3(R, R @ [0, 0, 0.05]))
    return sst_pin.ClosedChain(model, [], [], contacts=feet), place


def thrown(q0, count):
    """Starts above the slope, with rates that turn the body."""
    random = np.random.default_rng(0)
    q, va = np.tile(q0, (count, 1)), random.normal(size=(count, 6)) * [0.3, 0.3, 0.3, 2, 2, 2]
    q[:, 2] += 0.05
    return q, va


# --- arguments --------------------------------------------------------------------------------


def test_what_only_nonsmooth_steps_know_is_refused_elsewhere(tripod):
    chain, q0 = tripod
    batch = chain.warp("cpu")
    q, va, tau = q0[None], np.zeros((1, 6)), np.zeros((1, 0))
    with pytest.raises(InputError, match=r"foot_0.* act in step\(\.\.\., nonsmooth=True\) only"):
        batch.step((q, va), tau, 1e-3)
    bar = robots.four_bar()
    with pytest.raises(InputError, match=r"motor_damping: only with nonsmooth=True"):
        bar.warp("cpu").step((bar.home[None], [[0.0]]), [[0.0]], 1e-3, motor_damping=[1.0])


def test_arguments_of_nonsmooth_steps_are_checked():
    bar = robots.four_bar()
    batch = bar.warp("cpu")
    state, tau = (bar.home[None], np.zeros((1, 1))), np.zeros((1, 1))
    with pytest.raises(InputError, match=r"^dt: -0.001 is not above 0"):
        batch.step(state, tau, -1e-3, nonsmooth=True)
    with pytest.raises(InputError, match=r"^motor_positions: needed with motor_stiffness"):
        batch.step(state, tau, 1e-3, nonsmooth=True, motor_stiffness=[1.0])
    with pytest.raises(InputError, match=r"^motor_damping: -1 is negative"):
        batch.step(state, tau, 1e-3, nonsmooth=True, motor_damping=[-1.0])
    with pytest.raises(InputError, match=r"^iterations: -1, expected at least 0"):
        batch.step(state, tau, 1e-3, nonsmooth=True, iterations=-1)
    with pytest.raises(InputError, match=r"^tau: not an array of Warp"):
        batch.step(state, None, 1e-3, nonsmooth=True)
    with pytest.raises(InputError, match=r"^motor_positions: shape \(1, 3\), expected \(1, 1\)"):
        batch.step(state, tau, 1e-3, nonsmooth=True, motor_positions=state[0])
    with pytest.raises(InputError, match=r"^out: 2 arrays, expected q, va, contact_forces"):
        batch.step(state, tau, 1e-3, nonsmooth=True, out=state)


def test_a_robot_without_an_inertia_matrix_is_refused_as_in_rollout():
    massless = sst_pin.ClosedChain(tree(("slide", pin.JointModelPX(), 0.0, 0.0)), [], ["slide"])
    with pytest.raises(sst_pin.SSTError, match="mass"):
        massless.rollout(np.zeros((1, 1)), [0.0], [0.0], 1e-3, nonsmooth=True)
    with pytest.raises(CompilationError, match="the mass matrix is singular"):
        massless.warp("cpu").step((np.zeros((1, 1)),) * 2, np.zeros((1, 1)), 1e-3, nonsmooth=True)


# --- three feet that bounce, slide and stick ----------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_feet_bounce_slide_and_stick_as_on_the_reference_path(tripod, device, dtype):
    """Five starts. In the end the feet stick, and their forces carry the weight."""
    chain, q0 = tripod
    q, va = thrown(q0, 5)
    tau, h = np.zeros((5, 150, 0)), 2e-3
    batch = chain.warp(device, dtype)
    states, codes = steps(batch, q, va, tau, h)
    motion = chain.rollout(tau, q, va, h, nonsmooth=True)
    assert not codes.any()
    require_same(states, motion, h, dtype)
    assert (motion.contact_forces[..., 2].max(axis=1) > 0).all()
    weight = 2.0 * 9.81 * np.cos(0.2)  # across the slope
    forces = series(states, "contact_forces").sum(axis=2)
    assert np.abs(forces[:, -1, 2] - weight).max() < 1e-2
    # Forces change the rates of 2 kg in each step: twice their error, in two frames, is the most.
    error = 4 * 2.0 / h * np.abs(series(states, "va") - motion.va[:, 1:]).max()
    assert np.abs(forces - motion.contact_forces.sum(axis=2)).max() < error


@pytest.mark.slow
def test_steps_that_are_not_solved_say_so_and_keep_their_result(tripod, device):
    """Without rounds of the solver, impacts of several feet are not solved."""
    chain, q0 = tripod
    q, va = thrown(q0, 5)
    tau = np.zeros((5, 150, 0))
    batch = chain.warp(device)
    states, codes = steps(batch, q, va, tau, 2e-3, iterations=0)
    residual = series(states, "residual")
    assert set(codes.flat) == {Status.GOOD, Status.UNSOLVED}
    assert np.array_equal(codes == Status.UNSOLVED, residual > SOLVED["float64"])
    assert np.isfinite(states[-1].q.numpy()).all()
    _, codes = steps(batch, q, va, tau, 2e-3)
    assert not codes.any()


@pytest.mark.slow
def test_starts_that_the_reference_path_refuses_are_flagged(tripod, device):
    """And steps of a kilometre, which the reference path makes where no loops may open."""
    chain, q0 = tripod
    q, va = np.tile(q0, (4, 1)), np.zeros((4, 6))
    q[1, 2] -= 0.01
    va[2, 0], va[3, 0] = np.nan, 1e6
    (state,), codes = steps(chain.warp(device), q, va, np.zeros((4, 1, 0)), 1e-3)
    expected = [Status.GOOD, Status.VIOLATED, Status.NOT_FINITE, Status.MODE]
    assert codes[:, 0].tolist() == expected
    for name, array in state._asdict().items():
        bad = np.isnan(array.numpy().reshape(4, -1)).any(axis=1)
        empty = name in ("tensions", "line_friction")  # the tripod has no ropes and no lines
        assert bad.tolist() == [not empty and name != "impulses" and x != 0 for x in expected]
    for k, message in ((1, "foot_0 .* is violated"), (2, "nan")):
        with pytest.raises(sst_pin.SSTError, match=message):
            chain.rollout(np.zeros((1, 0)), q[k], va[k], 1e-3, nonsmooth=True)


@pytest.mark.slow
def test_substeps_are_steps_and_results_go_into_given_arrays(tripod, device):
    """Forces are means, the residual is the largest one, and the solver starts where it ended."""
    chain, q0 = tripod
    batch = chain.warp(device)
    tau = np.zeros((3, 100, 0))
    states, _ = steps(batch, *thrown(q0, 3), tau, 2e-3)
    many, _ = steps(batch, *thrown(q0, 3), tau[:, :25], 8e-3, substeps=4)
    for k, state in enumerate(many):
        parts = states[4 * k : 4 * k + 4]
        assert np.array_equal(state.va.numpy(), parts[-1].va.numpy())
        mean = np.mean([x.contact_forces.numpy() for x in parts], axis=0)
        assert np.abs(state.contact_forces.numpy() - mean).max() < 1e-12 * (1 + np.abs(mean).max())
        largest = np.max([x.residual.numpy() for x in parts], axis=0)
        assert np.array_equal(state.residual.numpy(), largest)
    state = many[20]
    (torque,) = arrays(batch, tau[:, 0])
    end = batch.step(state, torque, 8e-3, substeps=4, nonsmooth=True, out=state)
    assert end.q.ptr == state.q.ptr
    assert np.array_equal(end.q.numpy(), many[21].q.numpy())


@pytest.mark.slow
def test_machine_code_for_a_gpu_is_made_without_one(tripod, tmp_path):
    module = tripod[0].warp("cpu").nonsmooth_module()
    wp.compile_aot_module(module, arch=90, module_dir=str(tmp_path), use_ptx=False)
    (binary,) = tmp_path.glob("*.cubin")
    assert binary.stat().st_size > 10_000


# --- joints, ropes and cables -------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_each_crank_with_its_own_dry_friction_stops_as_on_the_reference_path(device, dtype):
    """Six cranks between two stops, pushed by a load; the ones with much friction stick."""
    bar = robots.four_bar()
    model = pin.Model(bar.mechanism.model)
    model.lowerPositionLimit[0], model.upperPositionLimit[0] = bar.home[0] + [-0.05, 0.3]

    def chain(coulomb):
        friction = {"coulomb_friction": [coulomb, 0, 0], "viscous_friction": [0.001, 0, 0.002]}
        damper = sst_pin.LineForce("universe", "rocker_pin", coulomb_friction=0.02)
        return sst_pin.ClosedChain(model, bar.closures, ["crank"], lines=[damper], **friction)

    frictions = np.array([0.01, 0.05, 0.1, 0.2, 0.4, 0.8])
    batch = chain(0.1).warp(device, dtype)
    numbers = np.repeat(batch.parameters.numpy(), 6, axis=0)
    numbers[:, batch.parameter_names.index("crank.coulomb")] = frictions
    tau, h = np.full((6, 150, 1), 0.5), 2e-3
    tau[:, 75:] = -0.3
    q, va = np.tile(bar.home, (6, 1)), np.zeros((6, 1))
    load = np.zeros((6, 3, 6))
    load[:, 0, 0] = 0.5
    wrenches = arrays(batch, load)[0]
    options = {"motor_damping": [1e-3], "external_wrenches": wrenches}
    states, codes = steps(batch.with_parameters(numbers), q, va, tau, h, **options)
    assert not codes.any()
    motions = []
    for friction in frictions:
        options["external_wrenches"] = load[0]
        motions.append(chain(friction).rollout(tau[0], q[0], va[0], h, nonsmooth=True, **options))
    motion = motions[0]._replace(
        q=np.stack([x.q for x in motions]), va=np.stack([x.va for x in motions])
    )
    require_same(states, motion, h, dtype)
    # The crank and the damper share what they hold at rest; their sum along the crank is unique.
    one = chain(0.1)
    rates = one.joint_rates(motion.q[:, :-1], np.ones(1))
    slope = one.engine.line_rates(motion.q[:, :-1], rates)[..., 0]

    def along_crank(joint_forces, line_friction):
        return joint_forces[..., 0] + slope * line_friction[..., 0]

    expected = along_crank(*(np.stack([getattr(x, k) for x in motions]) for k in FORCES))
    error = 150 * SOLVED[dtype] * np.abs(expected).max()
    assert np.abs(along_crank(*(series(states, k) for k in FORCES)) - expected).max() < error
    travels = [np.ptp(motion.q[:, 0]) for motion in motions]
    assert travels[-1] == 0
    assert travels[0] > 0.3


@pytest.mark.slow
def test_ropes_cables_and_gains_act_as_on_the_reference_path(device):
    """A bead that swings on a rope and a cable, and a motor that holds a length."""
    model = tree(("x", pin.JointModelPX(), 0.5, 0.0), ("z", pin.JointModelPZ(), 0.5, 0.0))
    frame(model, "bead", "z", (0, 0, 0))
    frame(model, "hook", "universe", (0.1, 0, 0.5))
    frame(model, "post", "universe", (-0.4, 0, 0.2))
    lines = [
        LineForce("post", "bead", stiffness=60, rest_length=0.4, damping=0.5, pulls_only=True),
        LineForce("universe", "bead", stiffness=2, rest_length=0.1, damping=0.1, name="strut"),
        LineForce("hook", "bead", name="winch", pulls_only=True),
    ]
    chain = sst_pin.ClosedChain(
        model,
        [],
        ["x", "strut", "winch"],
        coordinates=["x", "z"],
        lines=lines,
        contacts=[Rope("hook", "bead", 0.6)],
        viscous_friction=[0.1, 0],
        stiffness=[3.0, 0],
    )
    gains = {"motor_stiffness": [20.0, 3.0, 5.0], "motor_damping": [0.5, 0.1, 0.2]}
    random = np.random.default_rng(0)
    q, va = np.tile([0.05, -0.05], (6, 1)), random.normal(size=(6, 2))
    tau, h = random.normal(size=(6, 200, 3)), 2e-3
    positions = np.array([0.02, 0.1, 0.5])
    batch = chain.warp(device)
    (hold,) = arrays(batch, np.tile(positions, (6, 1)))
    states, codes = steps(batch, q, va, tau, h, motor_positions=hold, **gains)
    motion = chain.rollout(tau, q, va, h, nonsmooth=True, motor_positions=positions, **gains)
    assert not codes.any()
    require_same(states, motion, h, "float64")
    error = 200 * SOLVED["float64"] * motion.tensions.max()
    assert np.abs(series(states, "tensions") - motion.tensions).max() < error
    assert (motion.tensions.max(axis=(0, 1)) > 0).all()
    assert (motion.tensions.min(axis=(0, 1)) == 0).all()


# --- a biped ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_bipeds_land_on_their_feet_as_on_the_reference_path(device, dtype):
    """Eighteen coordinates, six loops, eight points; two states."""
    chain = biped()
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    gains = {"motor_stiffness": np.full(motors, 150.0), "motor_damping": np.full(motors, 1.0)}
    random = np.random.default_rng(0)
    q, va = np.tile(chain.home, (2, 1)), 0.05 * random.normal(size=(2, n))
    tau, h = np.zeros((2, 60, motors)), 2e-3
    joints = [chain.model.joints[chain.model.getJointId(name)] for name in chain.motor_names]
    positions = chain.home[[joint.idx_q for joint in joints]]
    batch = chain.warp(device, dtype)
    (hold,) = arrays(batch, np.tile(positions, (2, 1)))
    states, codes = steps(batch, q, va, tau, h, motor_positions=hold, **gains)
    motion = chain.rollout(tau, q, va, h, nonsmooth=True, **gains)
    assert not codes.any()
    require_same(states, motion, h, dtype)
    of_feet = motion.contact_forces[..., 2].reshape(2, 60, 2, 4)
    assert (of_feet.max(axis=(1, 3)) > 0).all()
    # Lengths below 1 m, rounded some times.
    assert np.abs(chain.residual(states[-1].q.numpy())).max() < 20 * np.finfo(dtype).eps
