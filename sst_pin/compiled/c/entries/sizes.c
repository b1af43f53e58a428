const int NAME(sizes_${word}_${entry})[] = {${size}, ${results}, ${sizes}, -1};
