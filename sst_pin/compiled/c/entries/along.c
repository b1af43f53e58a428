int ${word}_${entry}(const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{
    static const int sizes_in[] = {${sizes}};
    real x[${inputs}], y[${room}];
    return along(${name}_once, ${name}, ${arrays}, sizes_in, ${q}, ${directions}, ${inputs}, ${outputs},
        ${checks}, x, y, in, out, p, count, bad);
}
