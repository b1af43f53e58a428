/* SPDX-License-Identifier: BSD-2-Clause */
/* Batches of samples through compiled kernels, by one thread or several. A batch is divided into
 * parts; each thread takes the next part when it has finished one. `run_shared` evaluates a kernel,
 * `roll_shared` makes rollouts. */
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>

/* The arrays and the functions of c/driver.h and c/entries, which is compiled for each robot. */
typedef struct {
    char *data;
    ptrdiff_t sample_stride, number_stride;
} sample_array;

typedef struct {
    sample_array at;
    ptrdiff_t step_stride;
} motion_array;

typedef int (*run_function)(const sample_array *in, const sample_array *out, const double *p,
    ptrdiff_t count, unsigned char *bad);
typedef int (*roll_function)(const sample_array *in, const motion_array *tau, ptrdiff_t half,
    const motion_array *out, const double *p, double h, ptrdiff_t steps, ptrdiff_t count,
    ptrdiff_t *reached);

/* The most samples that a kernel computes at once. The samples of a part are a multiple of it, so
 * that only the last part has empty lanes. */
#define LANES_AT_MOST 8
/* Inputs and outputs in a part, 16 kB: with small parts all threads end at about the same time. */
#define NUMBERS_PER_PART 2048
/* Inputs and outputs for which a thread is worth its start, which takes some 50 microseconds. */
#define NUMBERS_PER_THREAD 32768
#define THREADS_AT_MOST 256
/* Time of a step of a rollout, in evaluations of a kernel. */
#define EVALUATIONS 8
/* Stack of a thread, as large as that of the main thread: the default of some systems is smaller
 * than large kernels need. */
#define STACK (8 << 20)

typedef struct batch batch;

/* Compute `count` samples from `first` on. Returns whether one of them is bad. */
typedef int part_function(const batch *all, ptrdiff_t first, ptrdiff_t count);

struct batch {
    part_function *part;
    const sample_array *in;
    const double *p;
    ptrdiff_t count;
    /* of a kernel */
    run_function run;
    int arrays; /* number of `in` */
    const sample_array *out;
    unsigned char *bad;
    /* of a rollout */
    roll_function roll;
    const motion_array *tau, *states;
    ptrdiff_t half, steps, *reached;
    double h;
    /* of the threads that share it */
    ptrdiff_t size; /* of a part */
    atomic_ptrdiff_t next;
    atomic_int any_bad;
};

/* The array without its samples before `first`. */
static sample_array from_sample(sample_array array, ptrdiff_t first)
{
    if (array.data)
        array.data += first * array.sample_stride;
    return array;
}

static int run_part(const batch *all, ptrdiff_t first, ptrdiff_t count)
{
    sample_array in[5], out = from_sample(*all->out, first);
    for (int a = 0; a < all->arrays; a++)
        in[a] = from_sample(all->in[a], first);
    return all->run(in, &out, all->p, count, all->bad + first);
}

static int roll_part(const batch *all, ptrdiff_t first, ptrdiff_t count)
{
    sample_array in[3];
    motion_array tau = *all->tau, states[3] = {all->states[0], all->states[1], all->states[2]};
    tau.at = from_sample(tau.at, first);
    for (int i = 0; i < 3; i++) {
        in[i] = from_sample(all->in[i], first);
        states[i].at = from_sample(states[i].at, first);
    }
    return all->roll(in, &tau, all->half, states, all->p, all->h, all->steps, count,
        all->reached + first);
}

/* What each thread does. */
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

/* Compute a batch by at most `threads` threads. `numbers`, the inputs and outputs of a sample,
 * estimate its time. Returns whether a sample is bad. If the system refuses a thread, the others do
 * its work. */
static int share(batch *all, ptrdiff_t numbers, ptrdiff_t threads)
{
    const double all_numbers = (double)all->count * (double)numbers;
    const ptrdiff_t worthwhile = 1 + (ptrdiff_t)(all_numbers / NUMBERS_PER_THREAD);
    pthread_t others[THREADS_AT_MOST];
    pthread_attr_t attributes;
    ptrdiff_t started = 0;
    threads = threads < worthwhile ? threads : worthwhile;
    threads = threads < THREADS_AT_MOST ? threads : THREADS_AT_MOST;
    if (threads < 2 || all->count <= LANES_AT_MOST)
        return all->part(all, 0, all->count);
    all->size = (NUMBERS_PER_PART / numbers / LANES_AT_MOST + 1) * LANES_AT_MOST;
    atomic_init(&all->next, 0);
    atomic_init(&all->any_bad, 0);
    if (pthread_attr_init(&attributes) == 0) {
        pthread_attr_setstacksize(&attributes, STACK);
        /* no more threads than parts; the calling thread is one of them */
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

/* Evaluate a kernel for `count` samples. `bad` becomes 1 for each bad sample. Returns whether there
 * is one. */
static int run_shared(run_function run, int arrays, const sample_array *in, const sample_array *out,
    const double *p, ptrdiff_t count, unsigned char *bad, ptrdiff_t numbers, ptrdiff_t threads)
{
    batch all = {.part = run_part, .run = run, .arrays = arrays, .in = in, .out = out, .p = p,
        .count = count, .bad = bad};
    return share(&all, numbers, threads);
}

/* Make rollouts of `count` motions with `steps` steps of length h. `reached` becomes the number of
 * valid states of each. */
static void roll_shared(roll_function roll, const sample_array *in, const motion_array *tau,
    ptrdiff_t half, const motion_array *states, const double *p, double h, ptrdiff_t steps,
    ptrdiff_t count, ptrdiff_t *reached, ptrdiff_t numbers, ptrdiff_t threads)
{
    batch all = {.part = roll_part, .roll = roll, .in = in, .tau = tau, .half = half,
        .states = states, .p = p, .h = h, .steps = steps, .count = count, .reached = reached};
    share(&all, EVALUATIONS * (steps + 1) * numbers, threads);
}
