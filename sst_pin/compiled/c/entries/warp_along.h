/* Kernels along directions: `compute_matrix` of driver.h, which explains the arrays, for one
 * direction after the other. The matrix is computed in `out`. PASS is the pass of group k, with
 * `count` coordinates. */
#define PASS(k, count, results, checks) \
    _Pragma("unroll 1") for (int l = 0; l < count; l++) { \
        real d[count]; \
        for (int j = 0; j < count; j++) \
            d[j] = j == l; \
        ${name}_pass_##k(x, own, once, d, y); \
        for (int j = 0; j < results; j++) \
            at(out, i, places_##k[j] + directions_##k[l] * strides_##k[j]) = y[j]; \
        for (int j = 0; j < checks; j++) \
            bad = bad || y[results + j] <= 1 ? bad : SINGULAR; \
    }
RUN
{
    static const int known_at[] = {${known_at}};
    static const int order[] = {${order}}, entry_at[] = {${entry_at}};
    ${tables}
    const parameters own = column(p, i);
    real x[${inputs}], once[${y_size}], y[${y_size_of_passes}];
    const real *inverses = once + ${outputs}, *L = inverses + ${rank}, *checks = L + ${entries};
    ${takes}
    ${name}_once(x, own, once);
    int bad = judge_numbers(x, ${q}, ${inputs});
    bad = bad ? bad : judge_checks(checks, ${checks});
    for (int j = 0; j < ${results}; j++)
        at(out, i, j) = 0;
    for (int j = 0; j < ${outputs}; j++)
        at(out, i, known_at[j]) = once[j];
    ${passes}
    /* multiply by A^-1 = L^-T D^-1 L^-1; rows of `out` by `order` */
    for (int k = 0; k < ${entries}; k++) {
        const int row = order[entry_at[2 * k]] * ${width};
        const int column = order[entry_at[2 * k + 1]] * ${width};
        for (int j = 0; j < ${width}; j++)
            at(out, i, row + j) -= L[k] * at(out, i, column + j);
    }
    for (int k = 0; k < ${rank}; k++)
        for (int j = 0; j < ${width}; j++)
            at(out, i, order[k] * ${width} + j) *= inverses[k];
    for (int k = ${entries} - 1; k >= 0; k--) {
        const int row = order[entry_at[2 * k]] * ${width};
        const int column = order[entry_at[2 * k + 1]] * ${width};
        for (int j = 0; j < ${width}; j++)
            at(out, i, column + j) -= L[k] * at(out, i, row + j);
    }
    real zero = 0; /* x * 0 is NaN, not zero, if x is not finite */
    for (int j = 0; j < ${results}; j++)
        zero += at(out, i, j) * 0;
    bad = bad || zero == 0 ? bad : NOT_FINITE;
    for (int j = 0; bad && j < ${results}; j++)
        at(out, i, j) = (number)NAN;
    tell(status, i, bad);
}
