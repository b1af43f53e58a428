${declarations}
int ${word}_${entry}(const sample_array *in, const sample_array *out, const double *p,
    ptrdiff_t count, unsigned char *bad)
{
    static const int sizes_in[] = {${sizes}}, known_at[] = {${known_at}};
    static const int order[] = {${order}}, entry_at[] = {${entry_at}};
    ${tables}
    static const direction_pass passes[] = {${passes}};
    static const directional_kernel f = {${name}_once, ${inputs}, ${q}, ${outputs}, ${checks},
        ${results}, ${width}, ${count}, known_at, passes, ${rank}, ${entries}, order, entry_at};
    double x[${inputs}], once[${y_size}], matrix[${results}];
    real y[${y_size_of_passes}];
    return run_by_directions(
        &f, ${arrays}, sizes_in, x, once, matrix, y, in, out, p, count, bad);
}
