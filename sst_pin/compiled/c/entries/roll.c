int run_${entry}(const sample_array *in, const motion_array *tau, ptrdiff_t half,
    const motion_array *out, const double *p, double h, ptrdiff_t steps, ptrdiff_t count,
    ptrdiff_t *reached)
{
    static const double units[] = {${units}};
    static const stepper f = {${q}, ${va}, ${tau}, ${load}, ${checks}, ${close_checks}, ${name},
        ${close}, units, ${bend}, ${tolerance}, ${travel}, ${nearby}, ${change}};
    real x[${inputs}], y[${y_size}], start[${states}], end[${states}];
    return roll(&f, x, y, start, end, in, tau, half, out, p, h, steps, count, reached);
}
