static const int row_start[] = {${row_start}}, row_column[] = {${row_column}};
static const int impulse_row[] = {${impulse_row}}, impulse_sign[] = {${impulse_sign}};
static const int implicit_row[] = {${implicit_row}}, stop_position[] = {${stop_position}};

void run_${entry}(const double *p, const double *numbers, double h, ptrdiff_t steps, ptrdiff_t count,
    const double *tau, const double *held, const double *load, double *q, double *va, double *forces,
    double *residual, double *impulses, ptrdiff_t *reached)
{
    static const double units[] = {${units}};
    static const rows_of_robot robot = {${counts}, ${places}, ${outputs}, ${checks}, row_start,
        row_column, impulse_row, impulse_sign, implicit_row, stop_position};
    static const nonsmooth_stepper f = {&robot, closing, ${terms}, advance,
        ${close_checks}, units, ${bend}, ${tolerance}, ${travel}, ${change}, ${least}};
    real x[${inputs}], y[${room}], start[2 * ${q}];
    double one[${outputs} + ${q} + ${n}];
    int flags[4 * ${m} + 1];
    double *work = malloc(WORKSPACE(${n}, ${m}) * sizeof(double));
    if (!work)
        return; /* no step is reached */
    nonsmooth_roll(&f, p, numbers, h, steps, count, tau, held, load, q, va, forces, residual, impulses,
        reached, x, y, start, work, flags, one);
    free(work);
}
