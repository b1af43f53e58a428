/* Where there are directions, what does not depend on them is computed once, and the results of
 * each are a column. */
RUN
{
    const int directions = ${directions}, columns = directions ? directions : 1;
    const parameters own = column(p, i);
    real x[${inputs}], y[${room}];
    int bad = 0;
    ${takes}
    ${once}
#pragma unroll 1
    for (int d = 0; d < columns; d++) {
        for (int j = 0; j < directions; j++)
            x[${inputs} - directions + j] = j == d;
        ${name}(x, own, y);
        bad = bad ? bad : judge(x, ${q}, ${inputs}, y, ${outputs}, ${checks});
        for (int j = 0; j < ${outputs}; j++)
            at(out, i, j * columns + d) = y[j];
    }
    for (int j = 0; bad && j < ${outputs} * columns; j++)
        at(out, i, j) = (number)NAN;
    tell(status, i, bad);
}
