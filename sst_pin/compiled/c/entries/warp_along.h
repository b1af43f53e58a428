static void run(int i, ${arrays}, const rows &p, const rows &out, int *status)
{
    const int directions = ${directions}, outputs = ${outputs};
    const parameters own = column(p, i);
    real x[${inputs}], y[${room}], *const direction = x + ${inputs} - directions;
    int bad = 0;
    ${takes}
    ${name}_once(x, own, y);
#pragma unroll 1
    for (int d = 0; d < directions; d++) {
        for (int j = 0; j < directions; j++)
            direction[j] = j == d;
        ${name}(x, own, y);
        bad = bad ? bad : judge(x, ${q}, ${inputs}, y, outputs, ${checks});
        for (int j = 0; j < outputs; j++)
            at(out, i, j * directions + d) = y[j];
    }
    for (int j = 0; bad && j < outputs * directions; j++)
        at(out, i, j) = (number)NAN;
    if (status)
        status[i] = bad;
}
