void NAME(prepare_${entry})(double *p)
{
    ${calls}
}
