void prepare_${entry}(double *p)
{
    ${calls}
}
