${declarations}
int ${word}_${entry}(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{
    static const int sizes_in[] = {${sizes}}, known_at[] = {${known_at}};
    static const int order[] = {${order}}, entry_at[] = {${entry_at}};
    ${tables}
    static const pass passes[] = {${passes}};
    static const columns f = {${name}_once, ${inputs}, ${q}, ${outputs}, ${checks}, ${results}, ${width},
        ${count}, known_at, passes, ${rank}, ${entries}, order, entry_at};
    double x[${inputs}], once[${room}], result[${results}];
    real y[${room_of_passes}];
    return run_columns(&f, ${arrays}, sizes_in, x, once, result, y, in, out, p, count, bad);
}
