const int sizes_${word}_${entry}[] = {${p_size}, ${results}, ${sizes}, -1};
