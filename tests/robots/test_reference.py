# SPDX-License-Identifier: BSD-2-Clause
"""The engine against the reference data, and the data against what they claim to be."""

import json
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.verification.lagrange import LagrangeMultipliers
from tests.data import REFERENCE
from tests.gallery import EVERY_ROBOT
from tests.support.files import load
from tests.support.named_robots import robot_named

describe = load("scripts/reference_data/plain_numbers.py").describe
make = load("scripts/reference_data/make_reference.py")


@pytest.fixture(scope="module", params=REFERENCE)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def chain(name):
    return sst_pin.SST() if name == "sst" else robot_named(name)


@pytest.fixture(scope="module")
def states(name):
    """All ten, each quantity in one array."""
    rows = REFERENCE[name]["states"]
    return SimpleNamespace(**{key: np.array([row[key] for row in rows], float) for key in rows[0]})


@pytest.fixture(scope="module")
def rates(name, chain):
    """Indices of the coordinates in v."""
    joints = [chain.model.joints[chain.model.getJointId(j)] for j in REFERENCE[name]["coordinates"]]
    return [joint.idx_v for joint in joints]


def model_of(record):
    """A Pinocchio model of a described robot, from the page's words alone."""
    model = pin.Model()
    model.gravity.linear = np.array(record["gravity"])
    kinds = {
        "revolute": pin.JointModelRevoluteUnaligned,
        "prismatic": pin.JointModelPrismaticUnaligned,
        "universal": pin.JointModelUniversal,
        "spherical": pin.JointModelSpherical,
        "free-flyer": pin.JointModelFreeFlyer,
    }
    for joint in record["joints"]:
        axes = [np.array(axis) for axis in joint.get("axes", [])]
        parent, at = placed(model, joint, "parent")
        index = model.addJoint(parent, kinds[joint["type"]](*axes), at, joint["name"])
        xx, yy, zz, xy, xz, yz = joint["inertia"]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = pin.Inertia(joint["mass"], np.array(joint["mass_centre"]), inertia)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
    closures = []
    for c, closure in enumerate(record["closures"]):
        for side in ("frame_a", "frame_b"):
            frame = f"{side}_{c}", *placed(model, closure[side], "joint")
            model.addFrame(pin.Frame(*frame, pin.FrameType.OP_FRAME))
        closures.append(sst_pin.Closure(f"frame_a_{c}", f"frame_b_{c}", closure["kind"]))
    return model, closures


def pulls(record, model, q, v):
    """What springs and dampers along lines do to the joints, shape (nv,)."""
    data, force = model.createData(), np.zeros(model.nv)
    pin.computeJointJacobians(model, data, q)
    for line in record["forces"]:
        ends = []
        for side in ("frame_a", "frame_b"):
            joint, at = placed(model, line[side], "joint")
            point = data.oMi[joint].act(at.translation)
            J = pin.getJointJacobian(model, data, joint, pin.WORLD)
            ends.append((point, J[:3] - pin.skew(point) @ J[3:]))
        (a, J_a), (b, J_b) = ends
        length = np.linalg.norm(b - a)
        rates = (b - a) / length @ (J_b - J_a)
        tension = line["stiffness"] * (length - line["rest_length"]) + line["preload"]
        force -= (tension + line["damping"] * rates @ v) * rates
    return force


def placed(model, record, key):
    """A joint and a placement on it; roll, pitch, yaw are about the fixed axes."""
    joint, at = record[key], record["placement"]
    rotation = pin.rpy.rpyToMatrix(np.radians(at["rpy_degrees"]))
    return 0 if joint == "base" else model.getJointId(joint), pin.SE3(rotation, np.array(at["xyz"]))


def off(actual, expected):
    """Largest difference in a state relative to its largest entry, or 1 % of the largest of all."""
    sizes = np.abs(expected).max(axis=-1, keepdims=True)
    return (np.abs(actual - expected) / np.maximum(sizes, 1e-2 * sizes.max())).max()


def test_the_data_cover_the_sst_and_the_whole_gallery():
    assert set(REFERENCE) == {"sst", *EVERY_ROBOT}
    for record in REFERENCE.values():
        assert len(record["states"]) == 10
        assert all(len(x.lstrip("-0.").split("e")[0]) >= 35 for x in record["states"][0]["torques"])


def test_the_description_is_that_of_the_robot(name, chain):
    now = json.loads(json.dumps(describe(chain)))
    assert now | {"states": REFERENCE[name]["states"]} == REFERENCE[name]


def test_the_states_close_the_loops(chain, states, rates):
    # Rounding of q to 1e-16, times lengths below 3 m.
    assert max(np.abs(chain.residual(q)).max(initial=0) for q in states.q) < 1e-14
    # The same, times the condition number of the passive joints, below 1e3, twice for rates'.
    assert off(chain.joint_rates(states.q, states.v[:, rates]), states.v) < 1e-12
    accelerations = chain.joint_accelerations(states.q, states.v[:, rates], states.dv[:, rates])
    assert off(accelerations, states.dv) < 1e-11


def test_torques_are_exact(chain, states, rates):
    tau = chain.compute_torques(states.q, states.v[:, rates], states.dv[:, rates])
    # Rounding times a condition number below 1e3.
    assert off(tau, states.torques) < 1e-12


def test_accelerations_are_exact(chain, states, rates):
    aa = chain.compute_accelerations(states.q, states.v[:, rates], states.given_torques)
    # As the torques, times the condition number of the inertia matrix, below 1e3.
    assert off(aa, states.accelerations) < 1e-10


def test_energies_are_exact(chain, states, rates):
    kinetic = chain.kinetic_energy(states.q, states.v[:, rates])
    # Rates to 1e-13 and more.
    assert_allclose(kinetic, states.kinetic_energy, rtol=1e-11)
    potential = chain.potential_energy(states.q)
    assert_allclose(potential, states.potential_energy, rtol=1e-13, atol=1e-14)


def test_the_description_alone_gives_the_torques(name, states, rates):
    """Read without the gallery, and judged by Lagrange multipliers in three states."""
    record = REFERENCE[name]
    model, closures = model_of(record)
    names = record["coordinates"]
    chain = sst_pin.ClosedChain(model, closures, record["motors"], coordinates=names)
    referee = LagrangeMultipliers(chain)
    rows = zip(states.q[:3], states.v[:3], states.dv[:3], states.torques[:3], strict=True)
    for q, v, dv, torques in rows:
        loads = pulls(record, model, q, v)
        tau = referee.torques(q, v[rates], dv[rates], loads)
        # Least squares: rounding times the condition number of all rows.
        assert off(tau[None], torques[None]) < 1e-11


@pytest.mark.parametrize("robot", ["planar_4rrr", "ups_pu"])
def test_the_states_are_those_that_the_script_makes(robot):
    record = {key: value for key, value in REFERENCE[robot].items() if key != "states"}
    made = make.states_of(robot, record, EVERY_ROBOT[robot]().home, count=1)
    assert made == REFERENCE[robot]["states"][:1]
