int ${word}_${entry}(const sample_array *in, const sample_array *out, const double *p,
    ptrdiff_t count, unsigned char *bad)
{
    static const int sizes_in[] = {${sizes}};
    real x[${inputs}], y[${y_size}];
    return run(${name}, ${close}, ${arrays}, sizes_in, ${q}, ${inputs}, ${outputs}, ${checks}, x, y,
        in, out, p, count, bad);
}
