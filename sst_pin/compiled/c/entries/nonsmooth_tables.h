/* this robot: its tables, and the bounds of its steps */
    static const int row_start[] = {${row_start}}, row_column[] = {${row_column}};
    static const int impulse_row[] = {${impulse_row}}, impulse_sign[] = {${impulse_sign}};
    static const int implicit_row[] = {${implicit_row}}, stop_position[] = {${stop_position}};
    static const number units[] = {${units}};
    static const number coordinate_scale[] = {${coordinate_scale}}, gap_scale[] = {${gap_scale}};
    static const robot_tables robot = {${counts}, ${places}, ${outputs}, ${checks}, row_start,
        row_column, impulse_row, impulse_sign, implicit_row, stop_position, coordinate_scale,
        gap_scale};
    static const bounds_of_step bounds = {
        ${q}, units, ${bend}, ${tolerance}, ${travel}, ${change}, ${least}};
