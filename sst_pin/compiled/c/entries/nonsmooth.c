void run_${entry}(const double *p, const double *numbers, double h, ptrdiff_t steps,
    ptrdiff_t count, const double *tau, const double *held, const double *load, double *q,
    double *va, double *forces, double *residual, double *impulses, ptrdiff_t *reached)
{
    ${tables}
    real x[${inputs}], y[${y_size}], ends[2 * ${q}];
    double terms[${outputs}], q_of_one[${q}], va_of_one[${n}];
    int flags[FLAGS(${m})];
    double *work = malloc(WORKSPACE(${n}, ${m}, ${motors}) * sizeof(double));
    if (!work)
        return; /* no step is reached */
    const motions all = {
        h, steps, count, tau, held, load, q, va, forces, residual, impulses, reached};
    const workspace w = {x, y, ends, terms, q_of_one, va_of_one, work, flags};
    nonsmooth_roll(&robot, &bounds, p, numbers, &all, &w);
    free(work);
}
