# SPDX-License-Identifier: BSD-2-Clause
"""The loops of `compiled/c/driver.h` over samples, with functions of one line as kernels."""

import ctypes

import pytest

from sst_pin.compiled.c_code import part
from sst_pin.compiled.compiler import compile_library

#: Kernels of a robot with one number in q, va and tau, and functions for the tests.
SOURCE = """
static void rest(const real *x, const double *p, real *y) { y[0] = y[1] = x[0] * 0; }
/* a step of a Newton method with the root 0, whose size is *p */
static void close(const real *x, const double *p, real *y)
{
    y[0] = x[0] * x[0] / *p;
    y[1] = y[2] = REAL(1);
}
static void one(const double *x, const double *p, const double *once, const real *d, real *y)
{
    y[0] = d[0];
    y[1] = REAL(*p);
}

double closed(double q, double length)
{
    const double units[] = {1 / length};
    const stepper f = {.q = 1, .close = close, .units = units};
    real x[] = {REAL(q)}, y[3];
    close_loops(&f, x, &length, y);
    return LANE(x[0], 0);
}

long valid_states(double torque)
{
    const double units[] = {1}, p = 1;
    const stepper f = {1, 1, 1, 0, 0, 0, rest, close, units, 1, 1, 1, 1, 2};
    double start = 0, q, va, verdict[2];
    const sample_array in[] = {{(char *)&start, 8, 8}, {(char *)&start, 8, 8}, {NULL, 0, 0}};
    const motion_array tau = {{NULL, 0, 0}, 0};
    const motion_array out[] = {
        {{(char *)&q, 8, 8}, 8}, {{(char *)&va, 8, 8}, 8}, {{(char *)verdict, 16, 8}, 16}};
    real x[] = {REAL(0), REAL(0), REAL(torque)}, y[3], from[2], to[2];
    ptrdiff_t reached = 0;
    roll(&f, x, y, from, to, in, &tau, 0, out, &p, 1.0, 0, 1, &reached);
    return reached;
}

int passes(double check)
{
    const int zero[] = {0};
    const direction_pass g = {one, 1, 1, 1, zero, zero, zero};
    double result[1];
    real y[2];
    return compute_pass(&g, NULL, &check, NULL, result, y);
}
"""


@pytest.fixture(scope="module", params=[1, 8], ids="{} lanes".format)
def library(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("driver") / "driver.so"
    source = "\n".join([*map(part, ("real.h", "distances.h", "driver.h")), SOURCE])
    compile_library([source], path, ["-O0", f"-DLANES={request.param}"])
    library = ctypes.CDLL(str(path))
    library.closed.argtypes = [ctypes.c_double, ctypes.c_double]
    library.closed.restype = ctypes.c_double
    library.valid_states.argtypes = library.passes.argtypes = [ctypes.c_double]
    return library


def test_the_start_of_a_rollout_without_steps_does_not_depend_on_its_workspace(library):
    assert library.valid_states(0.0) == library.valid_states(float("nan")) == 1


def test_loops_close_equally_well_in_all_units_of_length(library):
    """Three steps raise a relative error of 3e-3 to its eighth power; two would leave 8e-11."""
    for length in (1e-3, 1.0, 1e3):
        error = library.closed(3e-3 * length, length) / length
        assert error == pytest.approx(3e-3**8, rel=1e-9, abs=0)


def test_a_direction_is_valid_if_its_checks_are_at_most_1(library):
    assert library.passes(1.0)
    assert not library.passes(1.1)
