/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for NumPy.
 *
 * Inputs are float64 arrays of shape (core) or (n, core); one without the first axis goes with all
 * n samples. What is not of this kind is answered with None: the caller brings it into shape, or
 * says what is wrong with it. */
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
    PyObject *model; /* keeps `gravity` alive */
    const double *gravity; /* in the model's own memory */
    double gravity_then[3]; /* what it was when the parameters were made */
} Kernels;

/* Whether somebody has changed gravity since the parameters were made. */
static int stale(const Kernels *self)
{
    return memcmp(self->gravity, self->gravity_then, sizeof self->gravity_then) != 0;
}

static PyObject *kernels_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    static char *names[] = {"", "", "", NULL};
    PyObject *vector, *gravity, *model;
    if (!PyArg_ParseTupleAndKeywords(args, keywords, "O!O!O", names, &PyArray_Type, &vector,
            &PyArray_Type, &gravity, &model))
        return NULL;
    if (PyArray_TYPE((PyArrayObject *)gravity) != NPY_DOUBLE
        || !PyArray_ISCARRAY_RO((PyArrayObject *)gravity)
        || PyArray_SIZE((PyArrayObject *)gravity) != 3) {
        PyErr_SetString(PyExc_ValueError, "not an acceleration of gravity");
        return NULL;
    }
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
    self->model = Py_NewRef(model);
    self->gravity = PyArray_DATA((PyArrayObject *)gravity);
    memcpy(self->gravity_then, self->gravity, sizeof self->gravity_then);
    set->prepare(PyArray_DATA((PyArrayObject *)vector), self->wide);
    return (PyObject *)self;
}

static void kernels_dealloc(PyObject *self)
{
    free(((Kernels *)self)->wide);
    Py_XDECREF(((Kernels *)self)->model);
    Py_TYPE(self)->tp_free(self);
}

/* How many threads are asked for, as many as are useful; 0 for what is no such number. */
static int threads_of(PyObject *object)
{
    if (!PyLong_CheckExact(object))
        return 0;
    int overflow;
    const long threads = PyLong_AsLongAndOverflow(object, &overflow);
    return overflow > 0 || threads > MOST_THREADS ? MOST_THREADS : threads < 0 ? 0 : (int)threads;
}

/* Whether two arrays may share memory: results on top of inputs would be lost to those who look at
 * the inputs again. */
static int overlap(const rows *a, const rows *b, npy_intp samples)
{
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

/* What a map kernel takes and gives: the sizes of its inputs, which of them is the moment on the star
 * (0 for none), the size of its result and where this stands in a block. */
typedef struct {
    int kernel, ins, in[4], moment, size, position;
} face;

static const face inverse_dynamics_face = {INVERSE_DYNAMICS, 4, {9, 3, 3, 3}, 3, 3, 18};
static const face direct_dynamics_face = {DIRECT_DYNAMICS, 4, {9, 3, 3, 3}, 3, 3, 27};
static const face reduced_terms_face = {REDUCED_TERMS, 2, {9, 3}, 0, 24, 12};
static const face close_face = {CLOSE, 1, {9}, 0, 9, 0};
static const face determinant_face = {CLOSE, 1, {9}, 0, 1, 10};
static const face rate_face = {RATE, 3, {12, 3, 3}, 2, 12, 18};

static PyObject *wrong_count(Py_ssize_t wanted, Py_ssize_t nargs)
{
    return PyErr_Format(PyExc_TypeError, "%zd arguments, expected %zd", nargs, wanted);
}

/* The inputs through a kernel to `out`, which is made when it is None. Only the moment may be None.
 * Gives (flags, out), flags None where every sample is good; None for arguments of another kind. */
static PyObject *map_kernel(PyObject *self, const face *f, PyObject *const *inputs, PyObject *out,
    int threads)
{
    work w;
    w.kernel = f->kernel;
    w.ins = f->ins;
    w.position = f->position;
    w.any_bad = 0;
    w.p = ((Kernels *)self)->wide;
    w.loaded = f->moment && inputs[f->moment] != Py_None;
    npy_intp samples = -1;
    for (int i = 0; i < f->ins; i++) {
        if (f->moment && i == f->moment && !w.loaded)
            w.in[i] = (rows){NULL, 0, 0, f->in[i]};
        else if (rows_of(inputs[i], f->in[i], &samples, &w.in[i]))
            Py_RETURN_NONE;
    }
    const int single = samples < 0;
    const npy_intp shape[2] = {samples, f->size};
    PyObject *result = NULL;
    unsigned char one_flag = 0, *many_flags = NULL;
    const int given = out != Py_None;
    if (!given) {
        out = PyArray_SimpleNew(single ? 1 : 2, single ? shape + 1 : shape, NPY_DOUBLE);
        if (!out) { /* no memory for it: the reference path says so by name */
            PyErr_Clear();
            Py_RETURN_NONE;
        }
    } else {
        Py_INCREF(out);
    }
    npy_intp count = samples;
    if (rows_of(out, f->size, &count, &w.out[0]) || count != samples
        || !PyArray_ISWRITEABLE((PyArrayObject *)out)) {
        result = Py_NewRef(Py_None);
        goto end;
    }
    for (int i = 0; i < f->ins && given; i++)
        if (w.in[i].data && overlap(&w.in[i], &w.out[0], samples)) {
            result = Py_NewRef(Py_None);
            goto end;
        }
    ptrdiff_t next = 0;
    w.next = &next;
    w.samples = single ? 1 : samples;
    w.bad = &one_flag;
    if (w.samples > 1) {
        many_flags = PyMem_RawCalloc((size_t)w.samples, 1);
        if (!many_flags) {
            result = Py_NewRef(Py_None);
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
    PyObject *flags;
    if (w.any_bad) {
        flags = PyArray_SimpleNew(single ? 0 : 1, &w.samples, NPY_BOOL);
        if (!flags)
            goto end;
        memcpy(PyArray_DATA((PyArrayObject *)flags), w.bad, (size_t)w.samples);
    } else {
        flags = Py_NewRef(Py_None);
    }
    result = PyTuple_New(2);
    if (result) {
        PyTuple_SET_ITEM(result, 0, flags);
        PyTuple_SET_ITEM(result, 1, Py_NewRef(out));
    } else {
        Py_DECREF(flags);
    }
end:
    PyMem_RawFree(many_flags);
    Py_DECREF(out);
    return result;
}

/* (inputs..., out, threads) */
static PyObject *map_in_threads(PyObject *self, const face *f, PyObject *const *args,
    Py_ssize_t nargs)
{
    if (nargs != f->ins + 2)
        return wrong_count(f->ins + 2, nargs);
    const int threads = threads_of(args[f->ins + 1]);
    if (threads < 1 || stale((Kernels *)self))
        Py_RETURN_NONE;
    return map_kernel(self, f, args, args[f->ins], threads);
}

/* (inputs...) */
static PyObject *map_here(PyObject *self, const face *f, PyObject *const *args, Py_ssize_t nargs)
{
    if (nargs != f->ins)
        return wrong_count(f->ins, nargs);
    return map_kernel(self, f, args, Py_None, 1);
}

static PyObject *inverse_dynamics(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_in_threads(self, &inverse_dynamics_face, args, nargs);
}

static PyObject *direct_dynamics(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_in_threads(self, &direct_dynamics_face, args, nargs);
}

static PyObject *reduced_terms(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_in_threads(self, &reduced_terms_face, args, nargs);
}

static PyObject *close_loops(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_here(self, &close_face, args, nargs);
}

static PyObject *determinant(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_here(self, &determinant_face, args, nargs);
}

static PyObject *rate(PyObject *self, PyObject *const *args, Py_ssize_t nargs)
{
    return map_here(self, &rate_face, args, nargs);
}

static int fits(PyArrayObject *array, int ndim, npy_intp n, npy_intp times, npy_intp size)
{
    return PyArray_CheckExact(array) && PyArray_TYPE(array) == NPY_DOUBLE
        && PyArray_ISBEHAVED_RO(array) && PyArray_NDIM(array) == ndim && PyArray_DIM(array, 0) == n
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
    PyObject *moment, *count;
    ptrdiff_t next = 0;
    work w = {.kernel = STEP, .p = ((Kernels *)self)->wide, .next = &next};
    if (!PyArg_ParseTuple(args, "dO!O!O!OO!O!O!O!", &w.h, &PyArray_Type, &q0, &PyArray_Type, &va0,
            &PyArray_Type, &tau, &moment, &PyArray_Type, &q, &PyArray_Type, &va, &PyArray_Type,
            &reached, &PyLong_Type, &count))
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
    const int threads = threads_of(count);
    int any_bad;
    Py_BEGIN_ALLOW_THREADS
    any_bad = do_in_threads(&w, threads);
    Py_END_ALLOW_THREADS
    return PyBool_FromLong(any_bad);
}

#define METHOD(name, function, text) \
    {name, (PyCFunction)(void (*)(void))function, METH_FASTCALL, text}

static PyMethodDef methods[] = {
    METHOD("inverse_dynamics", inverse_dynamics,
        "inverse_dynamics($self, q, va, aa, moment, out, threads, /)\n--\n\n(flags, tau)"),
    METHOD("direct_dynamics", direct_dynamics,
        "direct_dynamics($self, q, va, tau, moment, out, threads, /)\n--\n\n(flags, aa)"),
    METHOD("reduced_terms", reduced_terms,
        "reduced_terms($self, q, va, out, threads, /)\n--\n\n"
        "(flags, rows): inertia, coriolis, gravity, friction."),
    METHOD("close", close_loops, "close($self, q, /)\n--\n\n(flags, q): a step of Newton's method."),
    METHOD("determinant", determinant, "determinant($self, q, /)\n--\n\n(flags, det A)"),
    METHOD("rate", rate, "rate($self, state, tau, moment, /)\n--\n\n(flags, rate)"),
    {"rollout", rollout, METH_VARARGS,
        "rollout($self, dt, q0, va0, tau, moment, q, va, reached, threads, /)\n--\n\n"
        "Whether any sample stopped early."},
    {NULL, NULL, 0, NULL},
};

static PyTypeObject kernels_type = {
    PyVarObject_HEAD_INIT(NULL, 0)
    .tp_name = "sst_pin.sst.kernels._binding.Kernels",
    .tp_doc = "Kernels(vector, gravity, model): the kernels with the numbers of one robot.",
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
