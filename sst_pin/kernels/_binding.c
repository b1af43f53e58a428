/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for NumPy: strided rows in, blocks of vectors through the kernels, strided rows out.
 *
 * Inputs are float64 arrays of shape (core) or (n, core); one without the first axis goes with all
 * n samples. What is not of this kind is answered with None: the caller brings it into shape. */
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_22_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "sst_kernels.h"

#define LARGEST_ANGLE 1e6 /* of sst_sincos */
#define SST_DEFINITE 1e-12
#define BLOCK 32 /* samples that fit the first cache with all that belongs to them */
#define WIDTH 48 /* numbers of a sample, the most that a kernel takes and gives */
#define MOST_ARRAYS 5
#define MOST_THREADS 256
#define PARAMETERS (sizeof(sst_parameters) / sizeof(double))

enum { INVERSE_DYNAMICS, DIRECT_DYNAMICS, REDUCED_TERMS, CLOSE, RATE, STEP };

/* Where a sample's results, its check and the verdict stand among its WIDTH numbers; its inputs
 * stand first, of which `state` numbers are judged before they are replaced. The results of STEP are
 * judged when they come in themselves. */
typedef struct {
    int out, check, good, state;
} layout;

static const layout layouts[] = {
    [INVERSE_DYNAMICS] = {18, 21, 24, 0},
    [DIRECT_DYNAMICS] = {18, 30, 33, 0},
    [REDUCED_TERMS] = {12, 36, 39, 0},
    [CLOSE] = {0, 9, 12, 9},
    [RATE] = {18, 30, 33, 0},
    [STEP] = {24, 24, 27, 12},
};

/* An array of samples, `size` numbers each; strides in bytes. */
typedef struct {
    char *data;
    npy_intp row, column;
    int size;
} rows;

/* What a processor offers: blocks of samples are vectors of `lanes` samples. */
typedef struct {
    int lanes;
    const char *name;
    void (*prepare)(const double *parameters, double *wide);
    void (*gather)(double *block, int position, const rows *from, npy_intp first, int count);
    int (*run)(int kernel, const void *parameters, double h, int loaded, double *block,
        int count);
    void (*scatter)(const double *block, int position, const rows *to, npy_intp first, int count);
} instruction_set;

#if defined(__x86_64__)
#define LANES 4
#define TARGET __attribute__((target("avx2,fma")))
#define SET "AVX2 and FMA, four samples at once"
#define SST_NAME(name) name##_avx2
#include "lanes.h"
#undef LANES
#undef TARGET
#undef SET
#undef SST_NAME
#endif

#define LANES 2
#define TARGET
#define SET "what every processor has, two samples at once"
#define SST_NAME(name) name##_plain
#include "lanes.h"

static const instruction_set *best(void)
{
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return &set_avx2;
#endif
    return &set_plain;
}

/* The one in use. */
static const instruction_set *set;

/* A number of a sample in a block. */
static inline const double *number(const double *block, int sample, int position)
{
    const int lanes = set->lanes;
    return block + ((sample / lanes) * WIDTH + position) * lanes + sample % lanes;
}

static inline int is_good(const double *block, int sample, int position)
{
    int64_t good;
    memcpy(&good, number(block, sample, position), sizeof good);
    return good != 0;
}

/* --- work ------------------------------------------------------------------------------------ */

/* Samples first to last of one call. */
typedef struct {
    int kernel;
    const void *p; /* parameters in all lanes */
    rows in[MOST_ARRAYS], out[MOST_ARRAYS];
    int ins, outs, loaded; /* loaded: with a moment on the star */
    npy_intp first, last;
    unsigned char *bad; /* one flag for each sample */
    int any_bad;
    /* Of STEP, which goes along a course of states: */
    double h;
    npy_intp steps;
    npy_intp tau_half, tau_step, q_step, va_step; /* strides to half a step and a step later */
    npy_intp *reached;                            /* states that hold, for each sample */
} work;

static void map_block(work *w, npy_intp first, int count)
{
    double block[BLOCK * WIDTH] __attribute__((aligned(64)));
    const layout at = layouts[w->kernel];
    int position = 0;
    for (int a = 0; a < w->ins; a++) {
        if (w->in[a].data)
            set->gather(block, position, &w->in[a], first, count);
        position += w->in[a].size;
    }
    const int all_good = set->run(w->kernel, w->p, 0, w->loaded, block, count);
    position = at.out;
    for (int a = 0; a < w->outs; a++) {
        if (w->out[a].data)
            set->scatter(block, position, &w->out[a], first, count);
        position += w->out[a].size;
    }
    for (int i = 0; i < count && !all_good; i++)
        if (!is_good(block, i, at.good))
            w->bad[first + i] = w->any_bad = 1;
}

/* Count the states that hold: up to one that a kernel does not vouch for, or where det A has
 * another sign than at the start. */
static void judge(work *w, const double *block, npy_intp first, int count, npy_intp state,
    double *sign)
{
    const layout at = layouts[STEP];
    for (int i = 0; i < count; i++) {
        const double det = *number(block, i, at.check + 1);
        if (state == 0)
            sign[i] = det;
        if (w->reached[first + i] == state && is_good(block, i, at.good) && det * sign[i] > 0)
            w->reached[first + i] = state + 1;
    }
}

static void roll_block(work *w, npy_intp first, int count)
{
    double block[BLOCK * WIDTH] __attribute__((aligned(64)));
    double sign[BLOCK];
    rows tau = w->in[2], q = w->out[0], va = w->out[1];
    set->gather(block, 0, &w->in[0], first, count);
    set->gather(block, 9, &w->in[1], first, count);
    if (w->loaded)
        set->gather(block, 21, &w->in[3], first, count);
    for (npy_intp s = 0;; s++) {
        set->scatter(block, 0, &q, first, count);
        set->scatter(block, 9, &va, first, count);
        if (s == w->steps)
            break;
        for (int half = 0; half < 3; half++) {
            rows at = tau;
            at.data += half * w->tau_half;
            set->gather(block, 12 + 3 * half, &at, first, count);
        }
        set->run(STEP, w->p, w->h, w->loaded, block, count);
        judge(w, block, first, count, s, sign);
        tau.data += w->tau_step;
        q.data += w->q_step;
        va.data += w->va_step;
    }
    set->run(STEP, w->p, 0, 0, block, count); /* a step of no length, to judge the last state */
    judge(w, block, first, count, w->steps, sign);
    for (int i = 0; i < count; i++) {
        const npy_intp reached = w->reached[first + i];
        if (reached > w->steps)
            continue;
        w->any_bad = 1;
        for (npy_intp s = reached; s <= w->steps; s++)
            for (int a = 0; a < 2; a++) {
                char *at = w->out[a].data + (first + i) * w->out[a].row
                    + s * (a ? w->va_step : w->q_step);
                for (int j = 0; j < w->out[a].size; j++)
                    *(double *)(at + j * w->out[a].column) = NAN;
            }
    }
}

static void *do_work(void *argument)
{
    work *w = argument;
    for (npy_intp first = w->first; first < w->last; first += BLOCK) {
        const int count = (int)(w->last - first < BLOCK ? w->last - first : BLOCK);
        (w->kernel == STEP ? roll_block : map_block)(w, first, count);
    }
    return NULL;
}

/* The same in several threads, each with its share of whole blocks; returns whether any is bad. */
static int do_in_threads(const work *all, npy_intp samples, int threads)
{
    work parts[MOST_THREADS];
    pthread_t handles[MOST_THREADS];
    const npy_intp blocks = (samples + BLOCK - 1) / BLOCK;
    if (threads > blocks)
        threads = (int)(blocks > 0 ? blocks : 1);
    int any_bad = 0, started = 0;
    for (int t = threads - 1; t >= 0; t--) {
        parts[t] = *all;
        parts[t].first = blocks * t / threads * BLOCK;
        parts[t].last = t + 1 == threads ? samples : blocks * (t + 1) / threads * BLOCK;
        /* This thread does the first share, and those for which there is no thread to be had. */
        if (t > 0 && pthread_create(&handles[started], NULL, do_work, &parts[t]) == 0)
            started++;
        else
            do_work(&parts[t]);
    }
    for (int i = 0; i < started; i++)
        pthread_join(handles[i], NULL);
    for (int t = 0; t < threads; t++)
        any_bad |= parts[t].any_bad;
    return any_bad;
}

/* --- Python ---------------------------------------------------------------------------------- */

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
    [CLOSE] = {1, {9}, 2, {9, 3}, 0},      /* the second is the check */
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
    w.first = 0;
    w.last = single ? 1 : samples;
    w.bad = &one_flag;
    if (w.last > 1) {
        many_flags = PyMem_RawCalloc((size_t)w.last, 1);
        if (!many_flags) {
            PyErr_NoMemory();
            goto end;
        }
        w.bad = many_flags;
    }
    if (w.last <= BLOCK) {
        do_work(&w);
    } else {
        Py_BEGIN_ALLOW_THREADS
        w.any_bad = do_in_threads(&w, samples, threads);
        Py_END_ALLOW_THREADS
    }
    PyObject *flags = NULL;
    if (w.any_bad) {
        npy_intp count = w.last;
        flags = PyArray_SimpleNew(single ? 0 : 1, &count, NPY_BOOL);
        if (!flags)
            goto end;
        memcpy(PyArray_DATA((PyArrayObject *)flags), w.bad, (size_t)w.last);
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
    work w = {.kernel = STEP, .p = ((Kernels *)self)->wide};
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
    threads = threads < 1 ? 1 : threads > MOST_THREADS ? MOST_THREADS : threads;
    int any_bad;
    Py_BEGIN_ALLOW_THREADS
    any_bad = do_in_threads(&w, n, threads);
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
    .tp_name = "sst_pin.kernels._binding.Kernels",
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
