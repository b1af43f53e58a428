/* SPDX-License-Identifier: BSD-2-Clause */
/* Strided rows in, blocks of vectors through the kernels, strided rows out, in several threads. */
#include <math.h>
#include <pthread.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "sst_kernels.h"

#define LARGEST_ANGLE 1e6 /* of sst_sincos */
#define SST_DEFINITE 1e-12
#define BLOCK 32 /* samples that fit the first cache with all that belongs to them */
#define WIDTH 48 /* numbers of a sample, the most that a kernel takes and gives */
#define MOST_INPUTS 4
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
    ptrdiff_t row, column;
    int size;
} rows;

/* What a processor offers: blocks of samples are vectors of `lanes` samples. */
typedef struct {
    int lanes;
    const char *name;
    void (*prepare)(const double *parameters, double *wide);
    void (*gather)(double *block, int position, const rows *from, ptrdiff_t first, int count);
    int (*run)(int kernel, const void *parameters, double h, int loaded, double *block,
        int count);
    void (*scatter)(const double *block, int position, const rows *to, ptrdiff_t first, int count);
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

/* One call, or one thread's part in it. */
typedef struct {
    int kernel;
    const void *p; /* parameters in all lanes */
    rows in[MOST_INPUTS], out[2]; /* STEP fills two arrays, the other kernels one */
    int ins, loaded;              /* loaded: with a moment on the star */
    int position;                 /* of the result in a block */
    ptrdiff_t samples, *next; /* how many, and the first that nobody has taken yet */
    unsigned char *bad;       /* one flag for each sample */
    int any_bad;
    /* Of STEP, which goes along a course of states: */
    double h;
    ptrdiff_t steps;
    ptrdiff_t tau_half, tau_step, q_step, va_step; /* strides to half a step and a step later */
    ptrdiff_t *reached;                            /* states that hold, for each sample */
} work;

static void map_block(work *w, ptrdiff_t first, int count)
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
    set->scatter(block, w->position, &w->out[0], first, count);
    for (int i = 0; i < count && !all_good; i++)
        if (!is_good(block, i, at.good))
            w->bad[first + i] = w->any_bad = 1;
}

/* Count the states that hold: up to one that a kernel does not vouch for, or where det A has
 * another sign than at the start. */
static void judge(work *w, const double *block, ptrdiff_t first, int count, ptrdiff_t state,
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

static void roll_block(work *w, ptrdiff_t first, int count)
{
    double block[BLOCK * WIDTH] __attribute__((aligned(64)));
    double sign[BLOCK];
    rows tau = w->in[2], q = w->out[0], va = w->out[1];
    set->gather(block, 0, &w->in[0], first, count);
    set->gather(block, 9, &w->in[1], first, count);
    if (w->loaded)
        set->gather(block, 21, &w->in[3], first, count);
    for (ptrdiff_t s = 0;; s++) {
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
        const ptrdiff_t reached = w->reached[first + i];
        if (reached > w->steps)
            continue;
        w->any_bad = 1;
        for (ptrdiff_t s = reached; s <= w->steps; s++)
            for (int a = 0; a < 2; a++) {
                char *at = w->out[a].data + (first + i) * w->out[a].row
                    + s * (a ? w->va_step : w->q_step);
                for (int j = 0; j < w->out[a].size; j++)
                    *(double *)(at + j * w->out[a].column) = NAN;
            }
    }
}

/* How many samples a thread takes at a time. */
static ptrdiff_t share_of(int kernel)
{
    return kernel == STEP ? BLOCK : 8 * BLOCK;
}

static void *do_work(void *argument)
{
    work *w = argument;
    const ptrdiff_t share = share_of(w->kernel);
    for (;;) {
        const ptrdiff_t begin = __atomic_fetch_add(w->next, share, __ATOMIC_RELAXED);
        for (ptrdiff_t first = begin; first < begin + share; first += BLOCK) {
            const ptrdiff_t left = w->samples - first;
            if (left <= 0)
                return NULL;
            (w->kernel == STEP ? roll_block : map_block)(w, first, left < BLOCK ? (int)left : BLOCK);
        }
    }
}

/* A thread and its part of the work. */
typedef struct {
    pthread_t handle;
    work part;
} helper;

/* All of it in several threads, this one among them; returns whether any sample is bad. */
static int do_in_threads(const work *all, int threads)
{
    const ptrdiff_t shares = (all->samples - 1) / share_of(all->kernel);
    const int wanted = shares < threads - 1 ? (int)shares : threads - 1;
    /* Not on the stack, which may be small. Without memory this thread does it alone. */
    helper *helpers = wanted > 0 ? malloc((size_t)wanted * sizeof *helpers) : NULL;
    int started = 0;
    while (helpers && started < wanted) {
        helpers[started].part = *all;
        if (pthread_create(&helpers[started].handle, NULL, do_work, &helpers[started].part))
            break; /* there are no more to be had */
        started++;
    }
    work own = *all;
    do_work(&own);
    for (int i = 0; i < started; i++) {
        pthread_join(helpers[i].handle, NULL);
        own.any_bad |= helpers[i].part.any_bad;
    }
    free(helpers);
    return own.any_bad;
}
