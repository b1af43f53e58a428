/* SPDX-License-Identifier: BSD-2-Clause */
/* Batches of samples through compiled kernels, by one thread or several. */
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>

/* As in c/driver.h. */
typedef struct {
    char *data;
    ptrdiff_t row, column;
} rows;

typedef struct {
    rows at;
    ptrdiff_t step;
} courses;

typedef int (*run_function)(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad);
typedef int (*roll_function)(const rows *in, const courses *tau, ptrdiff_t half,
    const courses *out, const double *p, double h, ptrdiff_t steps, ptrdiff_t count,
    ptrdiff_t *reached);

/* Samples in a part are a multiple of this, so that only the last part has empty lanes. */
#define LANES_AT_MOST 8
/* Numbers in a part, and numbers per thread: it takes some 50 microseconds to start a thread. */
#define PART 2048
#define WORTH 32768
#define THREADS_AT_MOST 256
/* Time of a step of a rollout, in evaluations of a kernel. */
#define EVALUATIONS 8
/* As that of the main thread: by default some systems give less than large kernels need. */
#define STACK (8 << 20)

typedef struct batch batch;

/* Returns whether a sample from `first` on, of `count`, is bad. */
typedef int part_function(const batch *all, ptrdiff_t first, ptrdiff_t count);

struct batch {
    part_function *part;
    const rows *in;
    const double *p;
    ptrdiff_t count;
    int arrays;
    /* of a kernel */
    run_function run;
    const rows *out;
    unsigned char *bad;
    /* of a rollout */
    roll_function roll;
    const courses *tau, *states;
    ptrdiff_t half, steps, *reached;
    double step;
    /* of the threads that share it */
    ptrdiff_t size;
    atomic_ptrdiff_t next;
    atomic_int any_bad;
};

static rows moved(rows from, ptrdiff_t first)
{
    if (from.data)
        from.data += first * from.row;
    return from;
}

static int run_part(const batch *all, ptrdiff_t first, ptrdiff_t count)
{
    rows in[5], out = moved(*all->out, first);
    for (int a = 0; a < all->arrays; a++)
        in[a] = moved(all->in[a], first);
    return all->run(in, &out, all->p, count, all->bad + first);
}

static int roll_part(const batch *all, ptrdiff_t first, ptrdiff_t count)
{
    rows in[3];
    courses tau = *all->tau, states[3] = {all->states[0], all->states[1], all->states[2]};
    for (int a = 0; a < 3; a++)
        in[a] = moved(all->in[a], first);
    tau.at = moved(tau.at, first);
    for (int i = 0; i < 3; i++)
        states[i].at = moved(states[i].at, first);
    return all->roll(in, &tau, all->half, states, all->p, all->step, all->steps, count,
        all->reached + first);
}

/* Each thread takes the next part when it has finished one. */
static void *take_parts(void *argument)
{
    batch *all = argument;
    ptrdiff_t first;
    while ((first = atomic_fetch_add(&all->next, all->size)) < all->count) {
        const ptrdiff_t left = all->count - first;
        if (all->part(all, first, left < all->size ? left : all->size))
            atomic_store(&all->any_bad, 1);
    }
    return NULL;
}

/* Returns whether a sample is bad. The inputs and outputs of a sample, `numbers`, estimate
 * its time. If the system refuses a thread, the others do its work. */
static int share(batch *all, ptrdiff_t numbers, ptrdiff_t threads)
{
    const ptrdiff_t worth = 1 + (ptrdiff_t)((double)all->count * (double)numbers / WORTH);
    pthread_t others[THREADS_AT_MOST];
    pthread_attr_t attributes;
    ptrdiff_t started = 0;
    threads = threads < worth ? threads : worth;
    threads = threads < THREADS_AT_MOST ? threads : THREADS_AT_MOST;
    if (threads < 2 || all->count <= LANES_AT_MOST)
        return all->part(all, 0, all->count);
    all->size = (PART / numbers / LANES_AT_MOST + 1) * LANES_AT_MOST;
    atomic_init(&all->next, 0);
    atomic_init(&all->any_bad, 0);
    if (pthread_attr_init(&attributes) == 0) {
        pthread_attr_setstacksize(&attributes, STACK);
        for (; started < threads - 1 && (started + 1) * all->size < all->count; started++)
            if (pthread_create(&others[started], &attributes, take_parts, all))
                break;
        pthread_attr_destroy(&attributes);
    }
    take_parts(all);
    for (ptrdiff_t k = 0; k < started; k++)
        pthread_join(others[k], NULL);
    return atomic_load(&all->any_bad);
}

/* Samples by a kernel; `bad` becomes 1 for each bad sample. Returns whether any is bad. */
static int run_shared(run_function run, int arrays, const rows *in, const rows *out,
    const double *p, ptrdiff_t count, unsigned char *bad, ptrdiff_t numbers, ptrdiff_t threads)
{
    batch all = {.part = run_part, .run = run, .arrays = arrays, .in = in, .out = out, .p = p,
        .count = count, .bad = bad};
    return share(&all, numbers, threads);
}

/* Motions by a rollout; `reached` becomes the number of valid states of each. */
static void roll_shared(roll_function roll, const rows *in, const courses *tau, ptrdiff_t half,
    const courses *states, const double *p, double step, ptrdiff_t steps, ptrdiff_t count,
    ptrdiff_t *reached, ptrdiff_t numbers, ptrdiff_t threads)
{
    batch all = {.part = roll_part, .roll = roll, .in = in, .tau = tau, .half = half,
        .states = states, .p = p, .step = step, .steps = steps, .count = count,
        .reached = reached};
    share(&all, EVALUATIONS * (steps + 1) * numbers, threads);
}
