/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for NumPy.
 *
 * Inputs are float64 arrays of shape (core) or (n, core); one without the first axis goes with all
 * n samples. What is not of this kind is answered with None: the caller brings it into shape. */
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_22_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>
#include <stdlib.h>
#include <string.h>

#include "blocks.h"

/* Take an array in as rows; -1 when it is not of the right kind. `samples` is -1 as long as no
 * array has said how many there are. */
static int rows_of(PyObject *object, int size, npy_intp *samples, rows *to)
{
    if (!PyArray_CheckExact(object))
        return -1;
    PyArrayObject *array = (PyArrayObject *)object;
    const int ndim = PyArray_NDIM(array);
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || ndim < 1 || ndim > 2
        || PyArray_DIM(array, ndim - 1) != size)
        return -1;
    if (ndim == 2) {
        if (*samples >= 0 && *samples != PyArray_DIM(array, 0))
            return -1;
        *samples = PyArray_DIM(array, 0);
    }
    to->data = PyArray_BYTES(array);
    to->row = ndim == 2 ? PyArray_STRIDE(array, 0) : 0;
    to->column = PyArray_STRIDE(array, ndim - 1);
    to->size = size;
    return 0;
}

/* The kernels with the numbers of one robot. */
typedef struct {
    PyObject_HEAD
    double *wide; /* its parameters in all lanes */
} Kernels;

static PyObject *kernels_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    PyObject *vector;
    if (keywords || !PyArg_ParseTuple(args, "O!", &PyArray_Type, &vector))
        return NULL;
    if (PyArray_TYPE((PyArrayObject *)vector) != NPY_DOUBLE
        || !PyArray_ISCARRAY_RO((PyArrayObject *)vector)
        || PyArray_SIZE((PyArrayObject *)vector) != (npy_intp)PARAMETERS) {
        PyErr_SetString(PyExc_ValueError, "not a parameter vector");
        return NULL;
    }
    Kernels *self = (Kernels *)type->tp_alloc(type, 0);
    if (!self)
        return NULL;
    const size_t size = PARAMETERS * sizeof(double) * (size_t)set->lanes;
    self->wide = aligned_alloc(64, (size + 63) / 64 * 64);
    if (!self->wide) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    set->prepare(PyArray_DATA((PyArrayObject *)vector), self->wide);
    return (PyObject *)self;
}

static void kernels_dealloc(PyObject *self)
{
    free(((Kernels *)self)->wide);
    Py_TYPE(self)->tp_free(self);
}

static int threads_of(PyObject *object)
{
    const long threads = PyLong_AsLong(object);
    if (threads == -1 && PyErr_Occurred())
        return -1;
    return (int)(threads < 0 ? 0 : threads > MOST_THREADS ? MOST_THREADS : threads);
}

/* Whether writing to b may change what is still to be read from a: they share memory, and not row
 * by row. */
static int in_the_way(const rows *a, const rows *b, npy_intp samples)
{
    if (!a->data || !b->data || (a->data == b->data && a->row == b->row && a->column == b->column))
        return 0;
    const rows *both[] = {a, b};
    char *low[2], *high[2];
    for (int i = 0; i < 2; i++) {
        const npy_intp along = (samples > 0 ? samples - 1 : 0) * both[i]->row;
        const npy_intp across = (both[i]->size - 1) * both[i]->column;
        low[i] = both[i]->data + (along < 0 ? along : 0) + (across < 0 ? across : 0);
        high[i] = both[i]->data + (along > 0 ? along : 0) + (across > 0 ? across : 0);
    }
    return low[0] <= high[1] && low[1] <= high[0];
}

/* What a map kernel takes and gives. */
typedef struct {
    int ins, in[4], outs, out[4];
    int moment; /* which input is the moment on the star, 0 for none */
} face;

static const face faces[] = {
    [INVERSE_DYNAMICS] = {4, {9, 3, 3, 3}, 1, {3}, 3},
    [DIRECT_DYNAMICS] = {4, {9, 3, 3, 3}, 2, {9, 3}, 3},
    [REDUCED_TERMS] = {2, {9, 3}, 4, {9, 9, 3, 3}, 0},
    [CLOSE] = {1, {9}, 2, {9, 3}, 0}, /* the second is the check */
    [RATE] = {3, {12, 3, 3}, 1, {12}, 2}, /* of (q, va) */
};

/* (inputs..., outputs..., threads): a moment of None is no moment, an output of None is made, one
 * of False left out. Gives (flags, outputs...), flags None where every sample is good. */
static PyObject *map_kernel(PyObject *self, int kernel, PyObject *const *args, Py_ssize_t nargs)
{
    const face *f = &faces[kernel];
    if (nargs != f->ins + f->outs + 1) {
        PyErr_SetString(PyExc_TypeError, "wrong number of arguments");
        return NULL;
    }
    work w;
    w.kernel = kernel;
    w.ins = f->ins;
    w.outs = f->outs;
    w.any_bad = 0;
    w.p = ((Kernels *)self)->wide;
    const int threads = threads_of(args[nargs - 1]);
    if (threads < 0)
        return NULL;
    if (threads == 0)
        Py_RETURN_NONE;
    npy_intp samples = -1;
    for (int i = 0; i < f->ins; i++) {
        if (args[i] == Py_None)
            w.in[i] = (rows){NULL, 0, 0, f->in[i]};
        else if (rows_of(args[i], f->in[i], &samples, &w.in[i]))
            Py_RETURN_NONE;
    }
    w.loaded = f->moment && w.in[f->moment].data;
    const int single = samples < 0;
    PyObject *outs[4] = {NULL}, *result = NULL;
    unsigned char one_flag = 0, *many_flags = NULL;
    for (int i = 0; i < f->outs; i++) {
        PyObject *out = args[f->ins + i];
        npy_intp shape[2] = {samples, f->out[i]};
        if (out == Py_False) {
            w.out[i] = (rows){NULL, 0, 0, f->out[i]};
            outs[i] = Py_NewRef(Py_None);
            continue;
        }
        if (out == Py_None) {
            outs[i] = PyArray_SimpleNew(single ? 1 : 2, single ? shape + 1 : shape, NPY_DOUBLE);
            if (!outs[i])
                goto end;
        } else {
            outs[i] = Py_NewRef(out);
        }
        npy_intp count = samples;
        if (rows_of(outs[i], f->out[i], &count, &w.out[i]) || count != samples
            || !PyArray_ISWRITEABLE((PyArrayObject *)outs[i])) {
            result = Py_NewRef(Py_None);
            goto end;
        }
        for (int j = 0; j < f->ins && out != Py_None; j++)
            if (in_the_way(&w.in[j], &w.out[i], samples)) {
                result = Py_NewRef(Py_None);
                goto end;
            }
    }
    ptrdiff_t next = 0;
    w.next = &next;
    w.samples = single ? 1 : samples;
    w.bad = &one_flag;
    if (w.samples > 1) {
        many_flags = PyMem_RawCalloc((size_t)w.samples, 1);
        if (!many_flags) {
            PyErr_NoMemory();
            goto end;
        }
        w.bad = many_flags;
    }
    if (w.samples <= BLOCK) {
        do_work(&w);
    } else {
        Py_BEGIN_ALLOW_THREADS
        w.any_bad = do_in_threads(&w, threads);
        Py_END_ALLOW_THREADS
    }
    PyObject *flags = NULL;
    if (w.any_bad) {
        npy_intp count = w.samples;
        flags = PyArray_SimpleNew(single ? 0 : 1, &count, NPY_BOOL);
        if (!flags)
            goto end;
        memcpy(PyArray_DATA((PyArrayObject *)flags), w.bad, (size_t)w.samples);
    } else {
        flags = Py_NewRef(Py_None);
    }
    result = PyTuple_New(1 + f->outs);
    if (!result) {
        Py_DECREF(flags);
        goto end;
    }
    PyTuple_SET_ITEM(result, 0, flags);
    for (int i = 0; i < f->outs; i++) {
        PyTuple_SET_ITEM(result, 1 + i, outs[i]);
        outs[i] = NULL;
    }
end:
    PyMem_RawFree(many_flags);
    for (int i = 0; i < f->outs; i++)
        Py_XDECREF(outs[i]);
    return result;
}

static PyObject *inverse_dynamics(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_kernel(self, INVERSE_DYNAMICS, args, nargs);
}

static PyObject *direct_dynamics(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_kernel(self, DIRECT_DYNAMICS, args, nargs);
}

static PyObject *reduced_terms(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_kernel(self, REDUCED_TERMS, args, nargs);
}

static PyObject *close_loops(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_kernel(self, CLOSE, args, nargs);
}

static PyObject *rate(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_kernel(self, RATE, args, nargs);
}

static int fits(PyArrayObject *array, int ndim, npy_intp n, npy_intp times, npy_intp size)
{
    return PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISBEHAVED_RO(array)
        && PyArray_NDIM(array) == ndim && PyArray_DIM(array, 0) == n
        && PyArray_DIM(array, ndim - 1) == size && (ndim == 2 || PyArray_DIM(array, 1) == times);
}

static rows along(PyArrayObject *array)
{
    const int last = PyArray_NDIM(array) - 1;
    return (rows){PyArray_BYTES(array), PyArray_STRIDE(array, 0), PyArray_STRIDE(array, last),
        (int)PyArray_DIM(array, last)};
}

/* (h, q0 (n, 9), va0 (n, 3), tau, moment (n, 3) or None, q (n, N + 1, 9), va (n, N + 1, 3), reached
 * (n,) of intp zeros, threads): whether any sample stopped early. The torques are (n, N, 3), held
 * over each step, or (n, 2 N + 1, 3), at the ends and in the middles of the steps. */
static PyObject *rollout(PyObject *self, PyObject *args)
{
    PyArrayObject *q0, *va0, *tau, *q, *va, *reached;
    PyObject *moment;
    ptrdiff_t next = 0;
    work w = {.kernel = STEP, .p = ((Kernels *)self)->wide, .next = &next};
    int threads;
    if (!PyArg_ParseTuple(args, "dO!O!O!OO!O!O!i", &w.h, &PyArray_Type, &q0, &PyArray_Type, &va0,
            &PyArray_Type, &tau, &moment, &PyArray_Type, &q, &PyArray_Type, &va, &PyArray_Type,
            &reached, &threads))
        return NULL;
    const npy_intp n = PyArray_SIZE(reached);
    w.steps = PyArray_NDIM(q) == 3 ? PyArray_DIM(q, 1) - 1 : -1;
    const int held = PyArray_NDIM(tau) == 3 && PyArray_DIM(tau, 1) == w.steps;
    if (w.steps < 0 || PyArray_TYPE(reached) != NPY_INTP || !PyArray_ISCARRAY(reached)
        || !PyArray_ISWRITEABLE(q) || !PyArray_ISWRITEABLE(va) || !fits(q0, 2, n, 0, 9)
        || !fits(va0, 2, n, 0, 3) || !fits(q, 3, n, w.steps + 1, 9)
        || !fits(va, 3, n, w.steps + 1, 3) || !fits(tau, 3, n, held ? w.steps : 2 * w.steps + 1, 3)
        || (moment != Py_None
            && (!PyArray_Check(moment) || !fits((PyArrayObject *)moment, 2, n, 0, 3)))) {
        PyErr_SetString(PyExc_ValueError, "arrays that do not fit together");
        return NULL;
    }
    w.in[0] = along(q0);
    w.in[1] = along(va0);
    w.in[2] = along(tau);
    w.loaded = moment != Py_None;
    if (w.loaded)
        w.in[3] = along((PyArrayObject *)moment);
    w.out[0] = along(q);
    w.out[1] = along(va);
    w.tau_half = held ? 0 : PyArray_STRIDE(tau, 1);
    w.tau_step = held ? PyArray_STRIDE(tau, 1) : 2 * PyArray_STRIDE(tau, 1);
    w.q_step = PyArray_STRIDE(q, 1);
    w.va_step = PyArray_STRIDE(va, 1);
    w.reached = PyArray_DATA(reached);
    w.samples = n;
    threads = threads < 1 ? 1 : threads > MOST_THREADS ? MOST_THREADS : threads;
    int any_bad;
    Py_BEGIN_ALLOW_THREADS
    any_bad = do_in_threads(&w, threads);
    Py_END_ALLOW_THREADS
    return PyBool_FromLong(any_bad);
}

static PyMethodDef methods[] = {
    {"inverse_dynamics", (PyCFunction)(void (*)(void))inverse_dynamics, METH_FASTCALL,
        "(q, va, aa, moment, tau, threads) -> (flags, tau)"},
    {"direct_dynamics", (PyCFunction)(void (*)(void))direct_dynamics, METH_FASTCALL,
        "(q, va, tau, moment, q_dot, aa, threads) -> (flags, q_dot, aa)"},
    {"reduced_terms", (PyCFunction)(void (*)(void))reduced_terms, METH_FASTCALL,
        "(q, va, inertia, coriolis, gravity, friction, threads) -> (flags, ...)"},
    {"close", (PyCFunction)(void (*)(void))close_loops, METH_FASTCALL,
        "(q, q, check, threads) -> (flags, q, check)"},
    {"rate", (PyCFunction)(void (*)(void))rate, METH_FASTCALL,
        "(state, tau, moment, rate, threads) -> (flags, rate)"},
    {"rollout", rollout, METH_VARARGS,
        "(h, q0, va0, tau, moment, q, va, reached, threads) -> bool"},
    {NULL, NULL, 0, NULL},
};

static PyTypeObject kernels_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "sst_pin.sst.kernels._binding.Kernels",
    .tp_doc = "Kernels(vector): the kernels with the numbers of one robot.",
    .tp_basicsize = sizeof(Kernels),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = kernels_new,
    .tp_dealloc = kernels_dealloc,
    .tp_methods = methods,
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_binding",
    .m_doc = "Compiled kernels of the SST.",
    .m_size = -1,
};

PyMODINIT_FUNC PyInit__binding(void)
{
    import_array();
    set = best();
    PyObject *module = PyModule_Create(&definition);
    if (module
        && (PyModule_AddStringConstant(module, "instructions", set->name) < 0
            || PyModule_AddType(module, &kernels_type) < 0))
        Py_CLEAR(module);
    return module;
}
