RUN
{
    const parameters own = column(p, i);
    real x[${inputs}], y[${y_size}];
    ${takes}
    ${name}(x, own, y);
    const int bad = judge(x, ${q}, ${inputs}, y, ${outputs}, ${checks});
    give(y, out, i, ${outputs}, bad);
    tell(status, i, bad);
}
