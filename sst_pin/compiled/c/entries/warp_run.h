static void run(int i, ${arrays}, const rows &p, const rows &out, int *status)
{
    real x[${inputs}], y[${room}];
    ${takes}
    ${name}(x, column(p, i), y);
    const int bad = judge(x, ${q}, ${inputs}, y, ${outputs}, ${checks});
    give(y, out, i, ${outputs}, bad);
    if (status)
        status[i] = bad;
}
