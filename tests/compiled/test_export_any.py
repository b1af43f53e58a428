# SPDX-License-Identifier: BSD-2-Clause
"""Any robot as C99, compiled strictly, gives what the package gives."""

import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ActuationError, ClosedChain, robots
from sst_pin.cli import main
from tests.gallery import EVERY_ROBOT
from tests.gallery.cable_printer import cable_printer
from tests.support import any_chain
from tests.support.exported_c import STRICT, TYPES, Exported

OPEN, SINGULAR, NOT_FINITE, LIMITS = 1, 2, 3, 4
#: Joints of all kinds, rolling and a coupling; a four-bar with lines and redundant motors.
QUICK = {"cart": any_chain.cart, "lines": any_chain.lines}
SLOW = [name for name in EVERY_ROBOT if name not in ("four_bar", "planar_4rrr")]
#: What comments say of them.
SAID = {
    "cart": {
        "robot.c": "spring reference of ball_qw",  # by the coordinates that they are
        "robot.h": "There is no robot_computed_torque: a coordinate is no single number of q",
    },
    "lines": {"robot.c": "line gas: stiffness, rest length, damping, preload"},
}


def worst(got, expected):
    return np.abs(got - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
@pytest.mark.parametrize("precision", TYPES)
def test_exported_dynamics_are_those_of_the_package(name, precision, tmp_path):
    """In double to 1e-11; in single to a hundred roundings times the condition number.

    The rounding of q alone moves the torques by some condition numbers of it. Accelerations are
    judged by the torques that they take, free of the conditioning of the inertia matrix.
    """
    chain = (EVERY_ROBOT | QUICK)[name]()
    exported = Exported(chain, tmp_path, precision)
    for file, comment in SAID.get(name, {}).items():
        assert comment in (tmp_path / file).read_text(encoding="utf-8")
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    q, va, aa = any_chain.states(chain, 6, 0)
    expected, forces = chain.compute_torques(q, va, aa), chain.generalized_forces(q, va, aa)
    opened = pin.integrate(chain.model, q[0], np.linspace(0.1, 0.2, chain.model.nv))
    code, _ = exported("torques", motors, opened, va[0], aa[0])
    assert code == (OPEN if chain.closures else 0)  # a governor is a tree
    for i in range(len(q)):
        roundings = 100 * np.finfo(np.float32).eps * chain.condition_number(q[i])
        allowed = 1e-11 if precision == "double" else roundings
        code, tau = exported("torques", motors, q[i], va[i], aa[i])
        assert code == 0
        assert np.abs(tau - expected[i]).max() < allowed * np.abs(expected).max()
        code, result = exported("accelerations", n, q[i], va[i], expected[i])
        assert code == 0
        taken = chain.generalized_forces(q[i], va[i], result.astype(float))
        assert np.abs(taken - forces[i]).max() < allowed * np.abs(forces).max()
        code, J = exported("actuator_jacobian", motors * n, q[i])
        expected_J = chain.actuator_jacobian(q[i])
        assert code == 0
        assert np.abs(J - expected_J.ravel()).max() < allowed * max(np.abs(expected_J).max(), 1)
        nearby = pin.integrate(chain.model, q[i], 1e-3 * np.ones(chain.model.nv))
        for _ in range(8):
            code, nearby = exported("assembly_step", len(nearby), nearby)
            if code == 0:
                break
        assert code == 0
        gap = np.abs(chain.residual(nearby.astype(float))).max(initial=0)
        assert gap < (1e-12 if precision == "double" else 1e-5)


@pytest.mark.parametrize("precision", TYPES)
def test_exported_computed_torque_is_that_of_the_package(precision, tmp_path):
    """At a sample of a motion, with full turns between, and within the limits of the motors."""
    chain, random = robots.five_bar(), np.random.default_rng(0)
    exported, t = Exported(chain, tmp_path, precision), np.linspace(0, 1, 11)
    x = chain.home[[0, 2]] + 0.3 * np.sin(np.outer(t, [1, 2]))
    motion, gains = sst_pin.coordinate_motion(chain, t, x), {"kp": [400, 300], "kd": [40, 30]}
    for limit in (1e3, 0.005):
        control = sst_pin.ComputedTorque(chain, motion, **gains, limits=limit)
        for k in (2, 5):
            q = chain.assemble(motion.q[k] + 0.1 * random.normal(size=chain.model.nq))
            va = motion.va[k] + random.normal(size=2)
            wanted = x[k] + [4 * np.pi, -2 * np.pi], motion.va[k], motion.aa[k]
            inputs = q, va, *wanted, *gains.values(), [limit, limit]
            code, tau = exported("computed_torque", 2, *inputs)
            assert code == 0
            exact = 1e-9 if precision == "double" else 1e-3  # of the spline of the controller
            assert tau == pytest.approx(control.torque(t[k], q, va), rel=exact)
            assert (np.abs(tau) == exported.type(0.005)).any() == (limit == 0.005)
    inputs = list(inputs)
    assert exported("computed_torque", 2, q, va, [np.nan, 0], *inputs[3:])[0] == NOT_FINITE
    assert exported("computed_torque", 2, q + 0.1, *inputs[1:])[0] == OPEN


@pytest.mark.parametrize("precision", TYPES)
def test_the_exported_functions_say_why_they_have_no_result(precision, tmp_path):
    chain = robots.four_bar()
    exported = Exported(chain, tmp_path, precision)
    one = np.ones(1)
    assert exported("torques", 1, chain.home, one, one)[0] == 0
    assert exported("torques", 1, chain.home + np.array([0, 1e-3, 0]), one, one)[0] == OPEN
    for bad in (np.nan, np.inf, -np.inf):
        for k in range(3):
            inputs = [chain.home.copy(), one.copy(), one.copy()]
            inputs[k][0] = bad
            assert exported("torques", 1, *inputs)[0] == NOT_FINITE
    turned = chain.home + np.array([2e6 * np.pi, 0, 0])
    assert exported("torques", 1, turned, one, one)[0] == NOT_FINITE
    assert exported("torques", 1, chain.home, 1e30 * one, one)[0] in (0, NOT_FINITE)


def test_fewer_motors_than_coordinates_export_forces(tmp_path):
    """The torques are not determined, what the motion needs is; here there are no motors."""
    five_bar = robots.five_bar()
    chain = ClosedChain(five_bar.model, five_bar.closures, [], coordinates=five_bar.coordinates)
    exported = Exported(chain, tmp_path)
    (q,), (va,), (aa,) = any_chain.states(chain, 1, 0)
    code, f = exported("forces", 2, q, va, aa)
    assert code == 0
    assert worst(f, chain.generalized_forces(q, va, aa)) < 1e-11
    code, result = exported("accelerations", 2, q, va, [])
    assert code == 0
    assert worst(result, chain.compute_accelerations(q, va, [])) < 1e-11


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The exported example of the SST, compiled."""
    folder = tmp_path_factory.mktemp("sst")
    export = ["compile", "--robot", sst_pin.URDF_PATH, "--export-c", str(folder)]
    assert main(export) == 0
    command = ["cc", *STRICT, "-o", folder / "dynamics", folder / "main.c", folder / "robot.c"]
    subprocess.run(list(map(str, command)), check=True)
    return folder / "dynamics"


def test_the_exported_example_computes_the_torques_of_motions(program):
    chain = ClosedChain.from_urdf(sst_pin.URDF_PATH)
    motion = any_chain.states(chain, 5, 0)
    lines = "\n".join(" ".join(map(repr, row.tolist())) for row in np.hstack(motion))
    result = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    tau = np.array([line.split() for line in result.stdout.splitlines()], dtype=float)
    assert worst(tau, chain.compute_torques(*motion)) < 1e-11


def test_the_exported_example_tells_what_it_cannot_compute(program):
    """Exit code 1, a message and no torques: never nan for nan, never half of the input."""
    good = [*sst_pin.SST().home.tolist(), *[0.0] * 6]

    def run(words):
        return subprocess.run([program], input=words, capture_output=True, text=True, check=False)

    def line(place, word):
        return " ".join([*map(repr, good[:place]), word, *map(repr, good[place + 1 :])])

    assert run("").returncode == 0
    assert len(run(line(14, "0.0")).stdout.split()) == 3
    cases = {
        "not finite": [line(i, w) for i in range(15) for w in ("nan", "-inf", "1e999")]
        + [line(9, "1e300"), line(4, repr(good[4] + 2e6 * np.pi))],
        "not a number": [line(0, "abc"), line(9, "0,3"), "abc", line(14, "0.0") + "\nend"],
        "inside a motion": ["1", line(14, "")],
        "loops are open": [line(1, "0.1")],
    }
    for message, inputs in cases.items():
        for words in inputs:
            result = run(words)
            assert (result.returncode, message in result.stderr) == (1, True), words
            assert "nan" not in result.stdout
            assert "inf" not in result.stdout
    full = Path("/dev/full")
    if full.exists():
        with full.open("w") as stdout:
            words = "\n".join([line(14, "0.0")] * 3)
            ends = {"stdout": stdout, "stderr": subprocess.PIPE}
            result = subprocess.run([program], input=words, text=True, check=False, **ends)
        assert (result.returncode, result.stderr) == (1, "cannot write\n")


def test_export_replaces_nothing_unasked(tmp_path, capsys):
    (tmp_path / "main.c").write_text("mine")
    export = ["compile", "--robot", "four_bar", "--export-c", str(tmp_path)]
    assert main(export) == 2
    assert "main.c: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["main.c"]
    assert main([*export, "--force"]) == 0
    assert "robot_torques" in (tmp_path / "main.c").read_text(encoding="utf-8")


@pytest.mark.parametrize("precision", TYPES)
@pytest.mark.parametrize("name", ["planar_4rrr", "cables"])
def test_exported_torques_within_limits_are_those_of_the_package(name, precision, tmp_path):
    """Limits that the smallest torques often exceed; none where the package finds none."""
    chain = cable_printer() if name == "cables" else robots.planar_4rrr()
    exported, random = Exported(chain, tmp_path, precision), np.random.default_rng(2)
    exact = 1e-8 if precision == "double" else 2e-3
    motors, n, answers = len(chain.motor_names), chain.degrees_of_freedom, set()
    for _ in range(12):
        q = chain.assemble(chain.home + 0.1 * random.normal(size=chain.model.nq))
        va, aa = np.zeros(n), 3 * random.normal(size=n)
        smallest = chain.compute_torques(q, va, aa)
        largest = random.uniform(0.85, 1.05) * np.abs(smallest).max()
        least = -largest
        if name == "cables":
            least, largest = random.uniform(1, 30), random.uniform(35, 60)
        limits = np.tile([least, largest], (motors, 1))
        code, tau = exported("limited_torques", motors, q, va, aa, limits.ravel())
        try:
            expected = chain.compute_torques(q, va, aa, limits=limits)
        except ActuationError:
            expected = None
        answers.add(code)
        assert code == (4 if expected is None else 0)
        if expected is not None:
            assert np.abs(tau - expected).max() < exact * np.abs(expected).max()
            room = 1e-6 * largest
            assert ((tau >= least - room) & (tau <= largest + room)).all()
    assert 0 in answers
    inputs = q, va, aa
    backwards = np.tile([1.0, -1.0], motors)
    assert exported("limited_torques", motors, *inputs, backwards)[0] == NOT_FINITE


@pytest.mark.parametrize("precision", TYPES)
def test_exported_lengths_without_tension_are_those_of_the_package(precision, tmp_path):
    """Of the published printer, with tensions within limits; cables that push have none."""
    chain, random = cable_printer(), np.random.default_rng(3)
    exported = Exported(chain, tmp_path, precision)
    exact = 1e-12 if precision == "double" else 1e-6
    stiffness = random.uniform(1e4, 5e4, 4)
    for _ in range(4):
        q = 0.3 * random.normal(size=3)
        tau = chain.compute_torques(q, np.zeros(3), np.zeros(3), limits=np.tile([5, 200], (4, 1)))
        code, lengths = exported("line_lengths", 4, q)
        assert code == 0
        assert lengths == pytest.approx(chain.line_lengths(q), rel=exact)
        code, lengths = exported("unstretched_lengths", 4, q, tau, stiffness)
        assert code == 0
        expected = sst_pin.control.unstretched_lengths(chain, q, tau, stiffness)
        assert lengths == pytest.approx(expected, rel=exact)
        assert (lengths < chain.line_lengths(q)).all()
    assert exported("unstretched_lengths", 4, q, [*tau[:3], -1.0], stiffness)[0] == LIMITS
    for bad in (0.0, -1.0, np.nan, np.inf):
        bad_stiffness = [*stiffness[:3], bad]
        assert exported("unstretched_lengths", 4, q, tau, bad_stiffness)[0] == NOT_FINITE
    assert exported("unstretched_lengths", 4, q, [np.nan, *tau[1:]], stiffness)[0] == NOT_FINITE
    assert exported("unstretched_lengths", 4, [np.nan, 0, 0], tau, stiffness)[0] == NOT_FINITE


def test_a_robot_without_surplus_motors_has_no_torques_within_limits(tmp_path):
    chain = robots.four_bar()
    sst_pin.write_c(chain, tmp_path)
    assert "robot_limited_torques" not in (tmp_path / "robot.h").read_text()


@pytest.mark.parametrize("kind", [pin.JointModelPX, pin.JointModelRY])
def test_a_robot_without_loops_compiles_strictly(kind, tmp_path):
    """Where q, rates or parameters have no influence, no parameter is unused."""
    model = pin.Model()
    joint = model.addJoint(0, kind(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(2, 0.1, 0.1, 0.1), pin.SE3.Identity())
    code, tau = Exported(ClosedChain(model, [], ["joint"]), tmp_path)(
        "torques", 1, *np.eye(3)[2:].T
    )
    assert code == 0
    assert np.isfinite(tau).all()
