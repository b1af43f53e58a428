# SPDX-License-Identifier: BSD-2-Clause
"""The border: what is no argument is refused, real numbers of any kind and layout are taken."""

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as numbers
from numpy.lib.stride_tricks import as_strided

import sst_pin
from sst_pin import arrays
from sst_pin.compiled import _binding
from tests.support import any_chain, link_tables
from tests.support.bad_calls import NOT_COUNTS, NOT_NAMES
from tests.support.sampling import random_states

HOME = sst_pin.SST().home
#: Kinds of numbers that are real, and kinds that are not.
KINDS = numbers.integer_dtypes() | numbers.unsigned_integer_dtypes() | numbers.floating_dtypes()
KINDS |= numbers.complex_number_dtypes() | numbers.unicode_string_dtypes()
KINDS |= numbers.boolean_dtypes()


@pytest.fixture(scope="module", params=["reference path", "kernels"])
def case(request, robot):
    """A robot, and q, va, aa of twenty motions."""
    if request.param == "kernels":
        chain = link_tables.four_bar(link_tables.SKEW_PLANE).chain()
        chain.compile()
        return chain, *any_chain.states(chain, 20, 0)
    return robot, *robot.joint_motion(*random_states(robot, np.random.default_rng(3), 20))


@settings(max_examples=150, derandomize=True, deadline=None, database=None)
@given(
    numbers.arrays(KINDS, numbers.array_shapes(min_dims=0, max_dims=3, max_side=3))
    | st.sampled_from([*NOT_COUNTS, *NOT_NAMES])
)
def test_the_border_returns_the_numbers_of_the_caller_or_refuses_them(value):
    """`finite_array` and `whole_number` against NumPy's and Python's own conversion."""
    try:
        array = arrays.finite_array("x", value, ())
    except sst_pin.InputError:
        pass
    else:
        assert np.asarray(value).dtype.kind in "iuf"
        assert np.array_equal(array, np.asarray(value).astype(float))
        assert np.isfinite(array).all()
    try:
        number = arrays.whole_number("n", value, 1)
    except sst_pin.InputError:
        pass
    else:
        assert (number, type(number)) == (value, int)
        assert not isinstance(value, bool)


@pytest.mark.parametrize(
    "out",
    [
        *(np.empty((2, 3), kind) for kind in (np.float32, int, complex, object, ">f8")),
        *(False, [0.0] * 3, "out", np.empty((7, 3)), np.empty((2, 3, 1)), np.ma.zeros((2, 3))),
        *(np.ndarray, np.broadcast_to(1.0, (2, 3)), as_strided(np.empty(2), (2, 3), (8, 0))),
    ],
)
def test_results_go_to_a_float64_array_of_their_shape_that_can_be_written(robot, out):
    q, rates = np.tile(HOME, (2, 1)), np.zeros((2, 3))
    with pytest.raises(sst_pin.InputError, match=r"^out: "):
        robot.compute_torques(q, rates, rates, out=out)


@pytest.mark.parametrize("fast", [True, False])
def test_bad_options_are_refused_on_every_call(fast):
    """Before the kernels are made and afterwards, with samples at fault and without."""
    chain = sst_pin.robots.four_bar()
    if fast:
        chain.compile()
    q, rates = np.tile(chain.home, (3, 1)), np.zeros((3, 1))
    one = as_strided(np.empty(1), (3, 1), (0, 8))  # one number for all samples
    for _ in range(2):
        for name, value in (("out", False), ("out", one), ("threads", 0), ("on_error", True)):
            for method in (chain.compute_torques, chain.compute_accelerations):
                with pytest.raises(sst_pin.InputError, match=f"^{name}: "):
                    method(q, rates, rates, **{name: value})
        with pytest.raises(sst_pin.InputError, match=r"^aa: "):
            chain.compute_torques(q, rates, None)  # no memory of an earlier call
        chain.compute_torques(q, rates, rates, on_error="".join(["na", "n"]))


@pytest.mark.parametrize("kind", ["float32", "longdouble", "uint64", ">i4", "lists"])
def test_real_numbers_of_any_kind_are_numbers(case, kind):
    """Rates that every kind can hold exactly give the same bits."""
    robot, (q, *_), *_ = case
    n = robot.degrees_of_freedom
    rates, more = np.array([1.0, 2, 3])[:n], np.array([4.0, 0, 5])[:n]
    expected = robot.compute_torques(q, rates, more)
    given = (rates.tolist(), more.tolist())
    if kind != "lists":
        given = (rates.astype(kind), more.astype(kind))
    assert np.array_equal(robot.compute_torques(q, *given), expected)


LAYOUTS = {
    "rows reversed": lambda x: x[::-1].copy()[::-1],
    "columns reversed": lambda x: x[:, ::-1].copy()[:, ::-1],
    "every other row": lambda x: np.repeat(x, 2, axis=0)[::2],
    "every other column": lambda x: np.repeat(x, 2, axis=1)[:, ::2],
    "Fortran order": np.asfortranarray,
    "big-endian": lambda x: x.astype(">f8"),
    "a subclass": lambda x: x.view(np.recarray),
    "unaligned": lambda x: np.frombuffer(b"." + x.tobytes(), offset=1).reshape(x.shape),
    "read-only": lambda x: np.frombuffer(x.tobytes()).reshape(x.shape),
}


@pytest.mark.parametrize(
    ("count", "layout"), [(0, "Fortran order"), *((7, layout) for layout in LAYOUTS)]
)
def test_memory_of_any_layout_gives_the_same_bits(case, count, layout):
    robot, *arrays = case
    arrays = [x[:count] for x in arrays]
    tau, given = robot.compute_torques(*arrays), [LAYOUTS[layout](x) for x in arrays]
    assert tau.shape == (count, len(robot.motor_names))
    result = robot.compute_torques(*given)
    assert type(result) is np.ndarray
    assert np.array_equal(result, tau)
    assert np.array_equal(robot.compute_torques(*(x[None] for x in given)), tau[None])
    for out in (np.full(tau.shape, np.nan)[::-1], np.empty((*tau.shape, 2))[..., 0]):
        assert robot.compute_torques(*given, out=out) is out
        assert np.array_equal(out, tau)


def test_leading_axes_of_all_arguments_broadcast(case):
    """Three grids that share no axis; single samples may round otherwise."""
    robot, q, va, aa = case
    grid = robot.compute_torques(q[:6].reshape(2, 1, 3, -1), va[:4, None], aa[0])
    assert grid.shape == (2, 4, 3, len(robot.motor_names))
    assert np.allclose(grid[1, 2, 0], robot.compute_torques(q[3], va[2], aa[0]), rtol=1e-12)
    lists = robot.compute_torques(q[0].tolist(), va[0].tolist(), aa[0].tolist())
    assert np.array_equal(lists, robot.compute_torques(q[0], va[0], aa[0]))


@pytest.mark.parametrize("count", [4, 40, 4000])
def test_results_over_the_inputs_do_not_change_what_is_still_to_be_read(case, count):
    """out is aa, with a sample at fault: its neighbours are computed from the aa that was given."""
    robot, *arrays = case
    if robot.backend.startswith("the reference path"):
        count = min(count, 40)
    q, va, aa = (x[np.arange(count) % 20] for x in arrays)
    q[1, -1] += 1e-3
    expected = robot.compute_torques(q, va, aa, on_error="nan")
    assert np.isnan(expected).all(axis=1).tolist() == [i == 1 for i in range(count)]
    over = aa.copy()
    robot.compute_torques(q, va, over, out=over, on_error="nan")
    assert np.array_equal(over, expected, equal_nan=True)
    shifted = np.concatenate([aa, aa[:1]])
    robot.compute_torques(q, va, shifted[:-1], out=shifted[1:], on_error="nan")
    assert np.array_equal(shifted[1:], expected, equal_nan=True)
    one = aa[0].copy()
    alone = robot.compute_torques(q[0], va[0], aa[0])
    assert np.array_equal(robot.compute_torques(q[0], va[0], one, out=one), alone)
    kept = aa.copy()
    with pytest.raises(sst_pin.ClosureError, match="the loops are open"):
        robot.compute_torques(q, va, kept, out=kept)
    assert np.array_equal(kept, aa)  # an error leaves the input as it was


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


def test_a_name_with_characters_of_patterns_matches_itself():
    known = ["leg[1].mass", "leg1.mass", "leg2.mass"]
    assert arrays.matching_names("parameter", "leg[1].mass", known) == known[:1]
    assert arrays.matching_names("parameter", "leg?.mass", known) == known[1:]
    with pytest.raises(sst_pin.UnknownNameError, match=r"parameter 'arm\.\*' not in the model"):
        arrays.matching_names("parameter", "arm.*", known)
