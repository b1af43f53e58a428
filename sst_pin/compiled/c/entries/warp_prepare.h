static void run(int i, const rows &numbers, number width, const rows &p)
{
    const constants own = column(p, i);
    for (int k = 0; k < ${parameters}; k++)
        own[k] = at(numbers, i, k);
    if (width >= 0)
        own[${sign_width}] = width;
    ${constants}
}
