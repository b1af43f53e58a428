# SPDX-License-Identifier: BSD-2-Clause
"""What comes in from outside: real numbers, or an error that names the argument."""

import ast
import datetime
import inspect
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import _binding
from sst_pin.sst import kernels
from sst_pin.verification.sampling import random_states

compiled = pytest.mark.skipif(bool(kernels.missing()), reason=f"no kernels: {kernels.missing()}")
#: NumPy's, before our error.
masks_warn = pytest.mark.filterwarnings("ignore:Warning. converting a masked:UserWarning")

TIMES = np.linspace(0, 0.01, 3)
HOME = sst_pin.SST().home
#: A good value of each argument.
GOOD = {
    "q": HOME,
    "q0": HOME,
    "near": HOME,
    "gamma": HOME[::3],
    "R": np.eye(3)[[1, 2, 0]],
    "branch": np.ones(3),
    "t": TIMES,
    "external_wrenches": np.zeros((9, 6)),
    "q_dot": np.zeros(9),
    "angle": np.array([0.3]),
    "dt": np.array(1e-3),
    "torques": np.zeros((2, 3)),
    "at": TIMES[:2],
    "samples": np.tile(np.eye(3), (3, 1, 1)),
} | dict.fromkeys(
    ("va", "va0", "aa", "tau", "platform_moment", "omega", "alpha", "torque"), np.zeros(3)
)


def motion(robot, **arrays):
    """A `Trajectory` of three samples at home, with some arrays replaced."""
    columns = {"q": np.tile(HOME, (3, 1))} | dict.fromkeys(("va", "aa", "tau"), np.zeros((3, 3)))
    names = robot.joint_names, [robot.joint_names[i] for i in robot.actuated]
    return sst_pin.Trajectory(TIMES, *(columns | arrays).values(), *names)


#: Public functions of a robot, with the names of their arrays in `GOOD`; keywords after the star.
CALLS = {
    "compute_torques": "q va aa * platform_moment external_wrenches",
    "compute_accelerations": "q va tau * platform_moment external_wrenches",
    "reduced_terms": "q va",
    "noc": "q va",
    "kinetic_energy": "q va",
    "potential_energy": "q",
    "friction_power": "q va",
    "joint_rates": "q va",
    "platform_velocity": "q va",
    "platform_orientation": "q",
    "Phi": "q",
    "Phi_dot": "q q_dot",
    "residual": "q",
    "assemble": "q",
    "mobility": "q",
    "condition_number": "q",
    "singularities": "q",
    "branch": "q",
    "inverse_kinematics": "R branch",
    "joint_motion": "R omega alpha branch",
    "forward_kinematics": "gamma near",
    "simulate": "torque q0 va0 t * platform_moment external_wrenches",
    "rollout": "torques q0 va0 dt * platform_moment",
}
FUNCTIONS = {
    "orientation": "angle angle angle",
    "paper_circle": "t",
    "interpolate_orientations": "t samples at",
}


def strings(x):
    return x.astype(str)


def strings_as_objects(x):
    return x.astype(str).astype(object)


def dates(x):
    return np.zeros(x.shape, "datetime64[s]")


def spans(x):
    return np.zeros(x.shape, "timedelta64[s]")


def list_of_dates(x):
    return np.full(x.shape, datetime.date(2020, 1, 1), object).tolist()


def complex_numbers(x):
    return x + 1j


def list_of_complex_numbers(x):
    return (x + 1j).tolist()


def truth_values(x):
    return np.ones(x.shape, bool)


def fields(x):
    return np.zeros(x.shape, [("a", float)])


def gaps(x):
    return np.full(x.shape, None).tolist()


def masked(x):
    return np.ma.masked_array(x, np.ones(x.shape, bool))


def masked_nowhere(x):
    return np.ma.masked_array(x)


def rows_of_masked(x):
    return [np.ma.masked_array(row, np.ones(np.shape(row), bool)) for row in np.atleast_1d(x)]


def ragged(x):
    return [[1.0], [1.0, 2.0]]


def endless(x):
    loop = []
    loop.append(loop)
    return loop


class Unwilling:
    """Its conversion fails by an error of its own."""

    def __array__(self, *_, **__):
        raise RuntimeError("no array today")


class Lying:
    """Promises an array that it does not have."""

    __array_interface__ = {"shape": "many", "typestr": "<f8", "version": 3}  # noqa: RUF012


def unwilling(x):
    return Unwilling()


def lying(x):
    return Lying()


def word(x):
    return "fast"


BAD = [
    strings, strings_as_objects, dates, spans, list_of_dates, complex_numbers,
    list_of_complex_numbers, truth_values, fields, gaps, masked, masked_nowhere, rows_of_masked,
    ragged, endless, unwilling, lying, word,
]  # fmt: skip


def arguments(signature):
    """Names of positional and of keyword arguments."""
    positional, _, keywords = signature.partition("*")
    return positional.split(), keywords.split()


def refused(function, signature, bad):
    """Every argument in turn replaced by what `bad` makes of it; the names that were accepted."""
    positional, keywords = arguments(signature)
    accepted = []
    for place, name in enumerate(positional + keywords):
        values = [GOOD[each] for each in positional]
        named = {}
        if place < len(positional):
            values[place] = bad(GOOD[name])
        else:
            named[name] = bad(GOOD[name])
        try:
            function(*values, **named)
        except sst_pin.InputError:
            continue
        accepted.append(name)
    return accepted


@masks_warn
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("method", CALLS)
def test_what_is_no_array_of_real_numbers_is_refused(method, fast, bad):
    """Each array of each method on both paths; the call is good but for it."""
    robot = sst_pin.SST(kernels=fast)
    positional, _ = arguments(CALLS[method])
    getattr(robot, method)(*(GOOD[name] for name in positional))
    assert refused(getattr(robot, method), CALLS[method], bad) == []


@masks_warn
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("function", FUNCTIONS)
def test_functions_of_motions_refuse_it_too(function, bad):
    """Those that need no robot."""
    assert refused(getattr(sst_pin, function), FUNCTIONS[function], bad) == []


@masks_warn
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", ["q", "va", "aa", "tau"])
def test_a_trajectory_refuses_it_too(robot, name, bad):
    """It would be written to a file."""
    good = getattr(motion(robot), name)
    with pytest.raises(sst_pin.InputError):
        motion(robot, **{name: bad(good)})


@masks_warn
@pytest.mark.parametrize("bad", BAD)
def test_parameters_refuse_it_too(bad):
    """By their own error, which lists every problem; numbers and scalars for all joints as well."""
    body = {"mass": 1.0, "center_of_mass": np.zeros(3), "inertia": np.eye(3)}
    default = sst_pin.Parameters()
    names = ("base_directions", "arc_angles", "gravity", "viscous_friction", "coulomb_friction")
    whole = {name: getattr(default, name) for name in (*names, "base_radius", "star_radius")}
    for make, good in ((sst_pin.RigidBody, body), (sst_pin.Parameters, whole)):
        for name, value in good.items():
            for value_or_scalar in (value, 1.0):
                wrong = good | {name: bad(np.asarray(value_or_scalar))}
                with pytest.raises(sst_pin.ParametersError, match=name):
                    make(**wrong)


@pytest.mark.parametrize("fast", [True, False])
def test_only_loads_may_be_none(fast):
    """Not memory of an earlier call: compute_torques(q, va, None) is refused by name."""
    robot = sst_pin.SST(kernels=fast)
    for method in ("compute_torques", "compute_accelerations", "reduced_terms"):
        names, _ = arguments(CALLS[method])
        good = [GOOD[name] for name in names]
        for batch in ((), (5,), (100,)):
            rows = [np.tile(x, (*batch, 1)) if batch else x for x in good]
            getattr(robot, method)(*rows)  # leaves numbers behind
            for place, name in enumerate(names):
                holed = [None if i == place else x for i, x in enumerate(rows)]
                with pytest.raises(sst_pin.InputError, match=f"^{name}: "):
                    getattr(robot, method)(*holed)
            if method != "reduced_terms":
                getattr(robot, method)(*rows, platform_moment=None, external_wrenches=None)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize(
    "out",
    [False, True, 0, [0.0] * 3, np.zeros(3, ">f8"), np.zeros((3, 1)), np.ma.zeros(3), np.zeros(4)],
    ids=repr,
)
def test_results_go_only_to_arrays_that_hold_them(fast, out):
    """out=False is not `no result`; a masked array may keep what is masked."""
    robot = sst_pin.SST(kernels=fast)
    for method in (robot.compute_torques, robot.compute_accelerations):
        for _ in range(2):  # before and after the kernels are made
            with pytest.raises(sst_pin.InputError, match=r"^out: "):
                method(HOME, np.zeros(3), np.zeros(3), out=out)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("on_error", ["ignore", "", None, True, b"nan", np.array("nan"), ["nan"]])
def test_a_policy_is_refused_or_accepted_whenever_it_is_asked_for(fast, on_error):
    """On the first call of a robot and on later ones, with samples at fault and without."""
    robot = sst_pin.SST(kernels=fast)
    q = np.tile(HOME, (3, 1))
    rates = np.zeros((3, 3))
    for _ in range(2):
        for method in (robot.compute_torques, robot.compute_accelerations):
            with pytest.raises(sst_pin.InputError, match=r"^on_error: .* unknown"):
                method(q, rates, rates, on_error=on_error)
        with pytest.raises(sst_pin.InputError, match=r"^on_error: .* unknown"):
            robot.reduced_terms(q, rates, on_error=on_error)
        robot.compute_torques(q, rates, rates, on_error="".join(["na", "n"]))


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("threads", [0, -1, -(2**100), 1.0, 1.5, True, "2", None, np.nan])
def test_threads_are_a_whole_number_of_at_least_one(fast, threads):
    """On both paths, though the reference path takes one; any number of them is good."""
    robot = sst_pin.SST(kernels=fast)
    q, rates = np.tile(HOME, (2, 1)), np.zeros((2, 3))
    tau = robot.compute_torques(q, rates, rates)
    for _ in range(2):
        for method in (robot.compute_torques, robot.compute_accelerations):
            with pytest.raises(sst_pin.InputError, match=r"^threads: "):
                method(q, rates, rates, threads=threads)
        with pytest.raises(sst_pin.InputError, match=r"^threads: "):
            robot.reduced_terms(q, rates, threads=threads)
        with pytest.raises(sst_pin.InputError, match=r"^threads: "):
            robot.rollout(rates, HOME, rates[0], 1e-3, threads=threads)
    for many in (2**40, 2**100, np.int64(2)):
        assert np.array_equal(robot.compute_torques(q, rates, rates, threads=many), tau)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("steps", [2.0, -1, True, "2"])
def test_steps_are_a_whole_number(fast, steps):
    """Two torques for two steps, but 2.0 of them are none."""
    robot = sst_pin.SST(kernels=fast)
    with pytest.raises(sst_pin.InputError, match=r"^steps: "):
        robot.rollout(np.zeros((2, 3)), HOME, np.zeros(3), 1e-3, steps=steps)
    assert robot.rollout(np.zeros((1, 3)), HOME, np.zeros(3), 1e-3, steps=0).q.shape == (1, 9)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("name", ["rtol", "atol", "max_condition_number", "sign_width"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-3, 0.0, "1e-3", 1j, None, [1e-3, 1e-3]])
def test_tolerances_that_mean_nothing_end_a_simulation_before_it_starts(fast, name, value):
    """rtol=nan would refine its steps for ever; a width of 0 is the sign itself."""
    robot = sst_pin.SST(kernels=fast)
    arguments = np.zeros(3), HOME, np.zeros(3), [0, 1e-3]
    if name == "sign_width" and value == 0.0:
        assert len(robot.simulate(*arguments, sign_width=value)) == 2
        return
    with pytest.raises(sst_pin.InputError, match=rf"^{name}: "):
        robot.simulate(*arguments, **{name: value})


@pytest.mark.parametrize("fast", [True, False])
def test_a_rollout_takes_one_step_and_one_width(fast):
    """A negative width would drive the joints that friction should brake."""
    robot = sst_pin.SST(kernels=fast)
    arguments = np.zeros((2, 3)), HOME, np.zeros(3)
    for dt in (np.nan, "1", [1e-3, 1e-3], None):
        with pytest.raises(sst_pin.InputError, match=r"^dt: "):
            robot.rollout(*arguments, dt)
    for width in (np.nan, -1e-3, "1", [1.0, 1.0]):
        with pytest.raises(sst_pin.InputError, match=r"^sign_width: "):
            robot.rollout(*arguments, 1e-3, sign_width=width)


@pytest.mark.parametrize("method", ["RK4", "", None, 5])
def test_an_unknown_integrator_is_named(robot, method):
    """With those that there are."""
    with pytest.raises(sst_pin.InputError, match=r"^method: .* unknown; known: .*DOP853"):
        robot.simulate(np.zeros(3), HOME, np.zeros(3), [0, 1e-3], method=method)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize(
    "kind", ["float32", "float16", "longdouble", "int8", "uint64", ">f8", ">i4", "lists"]
)
def test_real_numbers_of_any_kind_are_numbers(fast, kind):
    """Rates that every kind can hold exactly give the same bits."""
    robot = sst_pin.SST(kernels=fast)
    rates, more = np.array([1.0, 2, 3]), np.array([4.0, 0, 5])
    expected = robot.compute_torques(HOME, rates, more)
    given = (rates.tolist(), more.tolist())
    if kind != "lists":
        given = (rates.astype(kind), more.astype(kind))
    assert np.array_equal(robot.compute_torques(HOME, *given), expected)


class Named(np.ndarray):
    """An array with a name, as many packages make."""


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("count", [0, 1, 7, 40])
def test_memory_of_any_layout_gives_the_same_bits(fast, count):
    """Reversed, every other row, repeated, read-only, a subclass, with an axis more."""
    robot = sst_pin.SST(kernels=fast)
    rng = np.random.default_rng(3)
    arrays = [x[:count] for x in robot.joint_motion(*random_states(robot, rng, 40))]
    tau = robot.compute_torques(*arrays)
    assert tau.shape == (count, 3)
    reversed_ = [x[::-1].copy()[::-1] for x in arrays]
    assert np.array_equal(robot.compute_torques(*reversed_), tau)
    columns = [x[:, ::-1].copy()[:, ::-1] for x in arrays]
    assert np.array_equal(robot.compute_torques(*columns), tau)
    spaced = [np.repeat(x, 2, axis=0)[::2] for x in arrays]
    assert np.array_equal(robot.compute_torques(*spaced), tau)
    named = [x.view(Named) for x in arrays]
    result = robot.compute_torques(*named)
    assert type(result) is np.ndarray
    assert np.array_equal(result, tau)
    wide = [x[None] for x in arrays]
    assert np.array_equal(robot.compute_torques(*wide), tau[None])
    out = np.full((count, 3), np.nan)[::-1]
    assert robot.compute_torques(*arrays, out=out) is out
    assert np.array_equal(out, tau)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("count", [4, 40, 4000])
def test_results_over_the_inputs_do_not_change_what_is_still_to_be_read(fast, count):
    """out is aa, with a sample at fault: its neighbours are computed from the aa that was given."""
    robot = sst_pin.SST(kernels=fast)
    if not fast:
        count = min(count, 40)
    rng = np.random.default_rng(4)
    q, va, aa = (
        x[np.arange(count) % 20] for x in robot.joint_motion(*random_states(robot, rng, 20))
    )
    q[1, 4] += 1e-3
    expected = robot.compute_torques(q, va, aa, on_error="nan")
    assert np.isnan(expected).all(axis=1).tolist() == [i == 1 for i in range(count)]
    over = aa.copy()
    robot.compute_torques(q, va, over, out=over, on_error="nan")
    assert np.array_equal(over, expected, equal_nan=True)
    one = aa[0].copy()
    assert np.array_equal(robot.compute_torques(q[0], va[0], one, out=one), expected[0])
    kept = aa.copy()
    with pytest.raises(sst_pin.ClosureError):
        robot.compute_torques(q, va, kept, out=kept)
    assert np.array_equal(kept, aa)  # an error leaves the input as it was


def test_results_over_overlapping_rows_of_an_input(robot):
    """Rows of q share memory with the rows before them, and with those of out that come first."""
    memory = np.tile(HOME.reshape(3, 3), (70, 1))
    q = np.lib.stride_tricks.as_strided(memory[200:], (200, 9), (-24, 8))
    va, aa = np.random.default_rng(5).normal(size=(2, 200, 3))
    expected = robot.compute_torques(q.copy(), va, aa)
    out = memory[200:0:-1]
    robot.compute_torques(q, va, aa, out=out)
    assert np.array_equal(out, expected)


def test_exact_fractions_are_converted_by_the_caller(robot):
    """Objects may be anything, None among them: the error says what was found."""
    with pytest.raises(sst_pin.InputError, match=re.escape("aa: not an array of numbers (dtype")):
        robot.compute_torques(HOME, np.zeros(3), [Fraction(1, 3)] * 3)


@compiled
def test_the_binding_says_what_its_stub_says():
    """Each method of the stub has the arguments of the compiled one."""
    stub = ast.parse(Path(_binding.__file__).with_name("_binding.pyi").read_text())
    for cls in (node for node in stub.body if isinstance(node, ast.ClassDef)):
        declared = {
            node.name: [argument.arg for argument in node.args.args]
            for node in cls.body
            if isinstance(node, ast.FunctionDef) and node.name != "__init__"
        }
        compiled_ones = {
            name: list(inspect.signature(method).parameters)
            for name, method in vars(getattr(_binding, cls.name)).items()
            if not name.startswith("__")
        }
        assert compiled_ones == declared


@compiled
def test_the_binding_refuses_what_is_no_code():
    """By Python's own errors: it is not for users."""
    gravity = np.zeros(3)
    for wrong in ((), (None,), (0, 0, (9,), 3, np.zeros(4), gravity, None)):
        with pytest.raises((TypeError, ValueError)):
            _binding.Kernel(*wrong)
    with pytest.raises((TypeError, ValueError)):
        _binding.Course(0, (9, 3, 3, 0), np.zeros(4), None)
