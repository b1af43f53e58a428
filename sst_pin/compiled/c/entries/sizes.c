const int sizes_${word}_${entry}[] = {${size}, ${results}, ${sizes}, -1};
