# SPDX-License-Identifier: BSD-2-Clause
"""Reactions in joints and closures, and which of them are unique."""

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import null_space

import sst_pin
from sst_pin import robots
from sst_pin.dynamics import dynamics, reactions
from tests.data import PUBLISHED
from tests.gallery import EVERY_ROBOT, andrews
from tests.support import any_chain
from tests.support.by_hand import add, at, in_units, mark
from tests.support.oblique import with_oblique_axes


def random_state(chain, seed):
    """A configuration on the closures, rates, wrenches on the bodies, torques."""
    random = np.random.default_rng(seed)
    va = random.uniform(-1, 1, chain.degrees_of_freedom)
    wrenches = random.normal(size=(chain.model.njoints - 1, 6))
    return chain.generic_configuration(), va, wrenches, random.normal(size=len(chain.motor_names))


def moved(wrench, lever):
    """[force; moment] about a point, from that about a point `lever` away from it."""
    return np.concatenate([wrench[:3], wrench[3:] + np.cross(lever, wrench[:3])])


def unbalanced(chain, q, va, aa, wrenches, w):
    """Newton and Euler of each body, base axes, shape (1 + r, 6): zero where it is balanced.

    Momentum changes by M t_dot + Omega M t with twists from the long form of Eq. (92). The first is
    the ground: what it gives, about the origin.
    """
    model, terms = chain.mechanism.model, chain.noc(q, va)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    v, v_dot = chain.joint_rates(q, va), chain.joint_accelerations(q, va, aa)
    t, t_dot = terms.K @ v, terms.K @ v_dot + terms.K_dot @ v
    left = np.zeros((model.njoints, 6))
    of_motion = (terms.M @ t_dot + terms.Omega @ terms.M @ t).reshape(-1, 6)
    left[1:] = of_motion[:, [3, 4, 5, 0, 1, 2]] - wrenches  # the terms have moments first
    centres = [place * body.lever for place, body in zip(data.oMi, model.inertias, strict=True)]

    def give(body, wrench, at, sign):
        turned = np.concatenate([at.rotation @ wrench[:3], at.rotation @ wrench[3:]])
        left[body] -= sign * moved(turned, at.translation - centres[body])

    for j in range(1, model.njoints):
        left[j, :3] -= model.inertias[j].mass * model.gravity.linear
        give(j, w.joints[j - 1], data.oMi[j], 1)
        give(model.parents[j], w.joints[j - 1], data.oMi[j], -1)
    for closure, wrench in zip(chain.closures, w.closures, strict=True):
        if isinstance(closure, sst_pin.Coupling):
            continue
        ends = [model.frames[model.getFrameId(name)] for name in frames_of(closure)]
        at = data.oMf[model.getFrameId(frames_of(closure)[1])]
        give(ends[1].parentJoint, wrench, at, 1)
        give(ends[0].parentJoint, wrench, at, -1)
    for line in chain.lines:
        names = line.frame_a, line.frame_b
        frames = [model.getFrameId(name) for name in names]
        way = np.subtract(*(data.oMf[frame].translation for frame in frames))  # from B to A
        length = np.linalg.norm(way)
        rates = np.subtract(*(chain.frame_jacobian(q, name)[:3] @ va for name in names))
        pull = line.preload + line.stiffness * (length - line.rest_length)
        pull = (pull + line.damping * rates @ way / length) * way / length
        for frame, sign in zip(frames, (-1, 1), strict=True):
            at = pin.SE3(np.eye(3), data.oMf[frame].translation)
            give(model.frames[frame].parentJoint, np.r_[pull, 0, 0, 0], at, sign)
    return left


def frames_of(closure):
    if isinstance(closure, sst_pin.Rolling):
        return closure.plane, closure.wheel
    return closure.frame_a, closure.frame_b


def soft(chain):
    """A stiffness for each joint and closure, none like another."""
    random = np.random.default_rng(1)
    names = (*chain.mechanism.model.names, *map(str, chain.closures))
    return {name: random.uniform(1, 2, 6) for name in list(names)[1:]}


def solved(chain, seed, **options):
    """A random state, and its reactions under random torques."""
    q, va, wrenches, tau = random_state(chain, seed)
    loads = {"external_wrenches": wrenches}
    aa = chain.compute_accelerations(q, va, tau, **loads)
    return (q, va, aa, wrenches), chain.reactions(q, va, tau=tau, **loads, **options)


def without_rotors(joint):
    """Rotors turn the joints only; without them what is transmitted balances."""
    chain = any_chain.with_joint(joint)
    chain.model.armature[:] = 0
    chain.refresh()
    return chain


#: Joints that a tree splits, with quaternions, and without end; lines with springs and dampers;
#: surplus motors; overconstrained robots; each type of closure.
CHAINS = {
    **{joint: partial(without_rotors, joint) for joint in ("composite", "free-flyer", "RUBX")},
    **{name: EVERY_ROBOT[name] for name in ("andrews", "governor", "planar_4rrr", "bennett")},
    "SST": sst_pin.SST,
    "delta": robots.delta,
    "mask": partial(any_chain.chain, kind=any_chain.CLOSURES[-1]),
    "rods": any_chain.rods,
    "coupled": any_chain.coupled,
    "rolling": partial(any_chain.rolling, False),
    "cart": any_chain.cart,
}


@pytest.mark.parametrize("name", CHAINS)
def test_newton_and_euler_close_for_every_body(name):
    """When soft joints make all reactions unique; the ground gives the rest."""
    chain = CHAINS[name]()
    state, w = solved(chain, 3, stiffness=soft(chain))
    ground, *bodies = unbalanced(chain, *state, w)
    tolerance = 1e-10 * (1 + np.abs(w.joints).max())
    assert np.abs(bodies).max() < tolerance
    assert w.ground == pytest.approx(ground, abs=tolerance)


def inner_stresses(chain, q):
    """Wrenches [force; moment] that balance on all bodies, shape (joints + closures, 6, k).

    From the equilibrium of all bodies in absolute coordinates. Unknown are the wrenches that joints
    and closures can transmit, whatever their motors do.
    """
    model = chain.mechanism.model
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    columns, owners = [], []

    def unknown(at, basis, parent, child):
        start = len(columns)
        for wrench in basis.T:  # in the axes at `at`
            column = np.zeros((model.njoints, 6))
            column[child] += at.act(pin.Force(wrench)).vector
            column[parent] -= at.act(pin.Force(wrench)).vector
            columns.append(column[1:].ravel())
        owners.append((basis, slice(start, len(columns))))

    for j in range(1, model.njoints):
        J, own = pin.getJointJacobian(model, data, j, pin.LOCAL), model.joints[j]
        S = np.linalg.svd(J[:, own.idx_v : own.idx_v + own.nv])[0]  # the first: twists of its rates
        unknown(data.oMi[j], S[:, own.nv :], model.parents[j], j)
    for closure in chain.closures:
        a, b = (model.frames[model.getFrameId(name)] for name in frames_of(closure))
        at = data.oMf[model.getFrameId(closure.frame_b)]
        turn = at.rotation.T @ data.oMf[model.getFrameId(closure.frame_a)].rotation
        if isinstance(closure, sst_pin.Distance):
            rod = at.translation - data.oMf[model.getFrameId(closure.frame_a)].translation
            basis = np.zeros((6, 1))
            basis[:3, 0] = at.rotation.T @ rod / np.linalg.norm(rod)
        else:
            basis = np.kron(np.eye(2), turn)[:, np.array(closure.held)]
        unknown(at, basis, a.parentJoint, b.parentJoint)
    matrix = np.array(columns).T
    free = null_space(matrix, rcond=1e-9)
    return np.array([basis @ free[own] for basis, own in owners])


@pytest.mark.parametrize("name", EVERY_ROBOT)
def test_verdicts_and_shares_are_those_of_the_equilibrium_of_all_bodies(name):
    """Unique is what no inner stress reaches; in soft joints no inner stress releases energy."""
    chain = EVERY_ROBOT[name]()
    stiffness, (_, rigid) = soft(chain), solved(chain, 3)
    (q, *_), w = solved(chain, 3, stiffness=stiffness)
    stresses = inner_stresses(chain, q)
    unique = np.linalg.norm(stresses, axis=2) < 1e-6
    assert np.array_equal(np.concatenate(w.determined), unique)
    assert np.array_equal(np.concatenate(w.elastic), ~unique)
    wrenches = np.concatenate([w.joints, w.closures])
    of_rigid = np.concatenate([rigid.joints, rigid.closures])
    scale = 1 + np.abs(wrenches).max()
    assert of_rigid[unique] == pytest.approx(wrenches[unique], abs=1e-12 * scale)
    assert np.isnan(of_rigid[~unique]).all()
    twists = wrenches / np.array([stiffness[part] for part in w.names])
    released = np.einsum("ijk,ij->k", stresses, twists)
    assert np.abs(released).max(initial=0) < 1e-9 * np.abs(twists).max()


def test_wrenches_that_are_not_unique_and_wrong_stiffnesses_are_named():
    chain = robots.four_bar()
    state = chain.home, [0], [0]
    w = chain.reactions(*state)
    with pytest.raises(sst_pin.IndeterminateError, match="rocker: force z, moment y are not"):
        w.of("rocker", complete=True)
    # Of a planar robot the force in its plane is unique: weights of the four-bar hang on two pins.
    assert np.array_equal(np.isnan(w.of("rocker")), [False, False, True, False, True, False])
    with pytest.raises(sst_pin.UnknownNameError, match="joint or closure 'wheel'"):
        w.of("wheel")
    with pytest.raises(sst_pin.InputError, match="six positive numbers"):
        chain.reactions(*state, stiffness={"crank": [1, 2, 3]})
    with pytest.raises(sst_pin.UnknownNameError, match="joint or closure"):
        chain.reactions(*state, stiffness={"wheel": np.ones(6)})


def test_closures_of_the_same_frames_have_names_of_their_own():
    """Two that hold a point together carry what one does; a name for both is none."""
    plain = robots.four_bar()
    (closure,) = plain.closures
    ends = closure.frame_a, closure.frame_b
    across, along = (True, False, True), (False, True, False)
    parts = [sst_pin.Closure(*ends, (*rows, False, False, False)) for rows in (across, along)]
    chain = sst_pin.ClosedChain(plain.model, parts, plain.motor_names)
    one = sst_pin.ClosedChain(plain.model, [sst_pin.Closure(*ends, "3d")], plain.motor_names)
    state = chain.home, [0.3], [0.4]
    names = [f"{closure} ({k})" for k in (1, 2)]
    w = chain.reactions(*state)
    assert w.names[-2:] == tuple(names)
    both = np.nansum(w.closures, axis=0)  # what is not unique is across the plane
    np.testing.assert_allclose(both, np.nan_to_num(one.reactions(*state).closures[0]), atol=1e-12)
    chain.reactions(*state, stiffness={names[0]: [1e3] * 6})
    for ask in (lambda: w.of(str(closure)), lambda: chain.reactions(*state, stiffness=ONES)):
        with pytest.raises(sst_pin.UnknownNameError, match=r"\(1\)"):
            ask()


ONES = {str(robots.four_bar().closures[0]): [1.0] * 6}


def test_a_batch_is_its_samples_and_may_leave_the_bad_out():
    chain = robots.five_bar()
    q, va, _, tau = random_state(chain, 1)
    many = [np.tile(x, (3, 1)) for x in (q, va, tau)]
    many[0][1] += 0.1  # an open loop
    with pytest.raises(sst_pin.ClosureError, match="1 of 3 samples"):
        chain.reactions(*many[:2], tau=many[2])
    out = np.empty((3, 5, 6))
    w = chain.reactions(*many[:2], tau=many[2], on_error="nan", out=out)
    assert np.isnan(w.joints[1]).all()
    assert not w.determined.joints[1].any()
    assert np.array_equal(w.joints[2], chain.reactions(q, va, tau=tau).joints, equal_nan=True)
    with pytest.raises(sst_pin.InputError, match="one of them is needed"):
        chain.reactions(q, va)


def door():
    """A door on two hinges one above the other, its weight along their common axis."""
    model, body = pin.Model(), pin.Inertia(10.0, np.array([0.5, 0, 0.5]), np.eye(3))
    hinge = add(model, 0, pin.JointModelRZ(), "lower", at(), body)
    for name, joint in (("frame", 0), ("leaf", hinge)):
        mark(model, joint, name, at(0, 0, 1))
    return sst_pin.ClosedChain(model, [sst_pin.Closure("frame", "leaf", "hinge")], ["lower"])


def test_hinges_of_a_door_share_its_weight_as_their_stiffnesses():
    """The moment of the weight is a couple of horizontal forces, whatever the stiffnesses."""
    chain, weight = door(), 98.1
    w = chain.reactions([0], [0], [0])
    assert not w.determined.joints[0, 2]
    with pytest.raises(sst_pin.IndeterminateError):
        w.of("lower", complete=True)
    turns = [1e-9] * 3  # so soft about all axes that they transmit no moment
    k = {"lower": [1, 1, 3, *turns], "frame - leaf": [1, 1, 1, *turns]}
    w = chain.reactions([0], [0], [0], stiffness=k)
    assert w.of("lower") == pytest.approx([weight / 2, 0, 0.75 * weight, 0, 0, 0], abs=1e-6)
    assert w.of("frame - leaf") == pytest.approx([-weight / 2, 0, weight / 4, 0, 0, 0], abs=1e-6)
    assert w.elastic.joints[0, 2]


def test_andrews_multipliers_are_the_published_ones():
    """M q_ddot + G^T lambda = f: the forces on the common tip are -lambda.

    The published rates break the closures by 3e-8, so that a motion that obeys these differs by
    1e-7 of the forces. With the published rates and accelerations as they stand it is 1e-10.
    """
    chain, given = andrews(), PUBLISHED["andrews"]
    q, v, v_dot = np.array([[given[x][k] for k in chain.joint_names] for x in ("q", "v", "dv")])
    published = np.array(list(given["forces"].values()))  # on the common tip
    beta = chain.joint_names.index("beta")
    w = chain.reactions(q, [v[beta]], [v_dot[beta]])
    assert w.determined.closures[:, :2].all()
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)
    R = data.oMf[chain.model.getFrameId("tip_of_theta")].rotation[:2, :2]
    assert w.closures[:, :2] @ R.T == pytest.approx(-published, abs=1e-7 * 199)

    context = chain.engine.reference.context
    context.evaluate(q)
    needed = context.tree_forces(v, v_dot)
    needed -= dynamics.applied_forces(context, chain.friction, q, v, None, np.array([0.033]))
    multipliers, _ = reactions._multipliers(context, needed)
    result = multipliers.reshape(3, 3)[:, :2]
    assert result == pytest.approx(-published, abs=1e-10 * 199)


def test_units_change_no_reaction():
    """Lengths in metres over `unit`: forces are as the unit, moments as its square."""
    plain, results = robots.planar_3rrr(), []
    q, va, wrenches, tau = random_state(plain, 2)
    for unit in (1.0, 1e3, 1e-3):
        model, closures, motors = in_units(plain.model, unit), plain.closures, plain.motor_names
        chain = sst_pin.ClosedChain(model, closures, motors, coordinates=list(plain.coordinates))
        size = np.repeat([unit, unit**2], 3)
        w = chain.reactions(q, va, tau=unit**2 * tau, external_wrenches=wrenches * size)
        results.append((w.joints / size, w.closures / size, np.concatenate(w.determined)))
    largest = np.nanmax(np.abs(results[0][0]))
    for other in results[1:]:
        assert np.array_equal(other[2], results[0][2])
        for part, wanted in zip(other[:2], results[0][:2], strict=True):
            assert part == pytest.approx(wanted, abs=1e-10 * largest, nan_ok=True)


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_forces_in_the_plane_are_unique_in_axes_along_the_plane(compiled):
    """They are those of the robot whose own axes are along its plane."""
    aligned = robots.four_bar()
    oblique = with_oblique_axes(aligned, 3)
    q = np.asarray(aligned.home)
    if compiled:
        oblique.compile()
    own = oblique.reactions(q, [0.3], [0.2])
    assert np.isnan(own.of("rocker")[:3]).all()  # each component has a part across the plane
    data = aligned.model.createData()
    pin.forwardKinematics(aligned.model, data, q)
    # The z axis of the rocker is the normal of the plane.
    R = data.oMi[aligned.model.getJointId("rocker")].rotation
    w = oblique.reactions(q, [0.3], [0.2], axes=R)
    expected = aligned.reactions(q, [0.3], [0.2], axes=R)
    assert np.isfinite(w.joints[:, :2]).all()
    np.testing.assert_allclose(w.joints, expected.joints, atol=1e-9)
    np.testing.assert_allclose(w.closures, expected.closures, atol=1e-9)
    assert expected.of("rocker") == pytest.approx(
        aligned.reactions(q, [0.3], [0.2]).of("rocker"), abs=1e-12, nan_ok=True
    )
    assert w.determined.joints[:, :2].all()
    assert not w.determined.joints[:, 2].any()


def test_the_unique_part_of_a_force_is_the_one_that_no_inner_stress_changes():
    """A plate on three parallel bars, in axes that are along nothing.

    Forces along the bars are shared. Across a bar, the balance of moments about its lower hinge
    gives half the weight of the bar to its upper end.
    """
    mass, lean, tilt, length = 2.0, 0.4, 0.3, 0.5
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    turn = pin.SE3(pin.exp3(np.array([0, 0, tilt])), np.zeros(3))
    bar = turn.inverse().act(np.array([0.0, length, 0.0]))  # in its own axes, upright at q = 0
    plate, closures = 0, []
    for k in range(3):
        foot = pin.SE3(np.eye(3), np.array([0.2 * k, 0, 0])) * turn
        joint = model.addJoint(plate and 0, pin.JointModelRZ(), foot, f"bar_{k}")
        inertia = pin.Inertia(mass, bar / 2, 0.01 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        if k == 0:
            plate = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), bar), "plate")
            model.appendBodyToJoint(plate, pin.Inertia(3.0, np.zeros(3), 0.01 * np.eye(3)), turn)
        else:
            on_plate = turn.inverse().act(np.array([0.2 * k, 0, 0]))
            for name, body, point in ((f"top_{k}", joint, bar), (f"hole_{k}", plate, on_plate)):
                place = pin.SE3(np.eye(3), point)
                model.addFrame(pin.Frame(name, body, place, pin.FrameType.OP_FRAME))
            closures.append(sst_pin.Closure(f"hole_{k}", f"top_{k}", "3d"))
    chain = sst_pin.ClosedChain(model, closures, ["bar_0"])
    angles = {"bar_0": lean, "plate": -lean, "bar_1": lean, "bar_2": lean}
    q = np.array([angles[name] for name in chain.joint_names])
    w = chain.reactions(q)
    assert np.isnan(w.closures[:, :3]).all()
    forces, counts = chain.engine.unique_forces(q, [0], [0], None, None)
    assert (counts[-2:] == 2).all()  # along the bar, and across the plane
    # In axes of the base: bars lean to -x, and the plate carries half of each bar.
    across = np.array([np.cos(lean), np.sin(lean), 0])
    expected = (across @ [0, mass * 9.81 / 2, 0]) * across
    R = pin.exp3(np.array([0, 0, tilt + lean]))  # frames `top` are on their bars
    for force in forces[-2:]:
        assert R @ force == pytest.approx(expected, abs=1e-9)


def test_axes_of_reactions_turn_the_wrenches_that_stiffnesses_share():
    chain = door()
    stiffness = {"lower": [1, 1, 3, 1, 1, 1], "frame - leaf": [1, 2, 1, 1, 1, 1]}
    own = chain.reactions([0.4], [0], [0], stiffness=stiffness)
    w = chain.reactions([0.4], [0], [0], stiffness=stiffness, axes=np.eye(3))
    data = chain.model.createData()
    pin.forwardKinematics(chain.model, data, np.array([0.4]))
    R = data.oMi[1].rotation
    assert w.of("lower")[:3] == pytest.approx(R @ own.of("lower")[:3], abs=1e-9)
    assert w.of("lower")[3:] == pytest.approx(R @ own.of("lower")[3:], abs=1e-9)


@pytest.mark.parametrize("axes", [np.eye(2), 2 * np.eye(3), "x", np.full((3, 3), np.nan)])
def test_axes_of_reactions_are_orthonormal(axes):
    chain = robots.four_bar()
    with pytest.raises(sst_pin.errors.InputError, match="axes"):
        chain.reactions(chain.home, [0], [0], axes=axes)
