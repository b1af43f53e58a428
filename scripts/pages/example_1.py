# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that did not come from this package."""

import numpy as np

#: Motor torques of example 1, [N m], at times in [s]: computed twice in other ways, one of them in
#: 40-digit arithmetic from vector geometry and angular momentum.
EXAMPLE_1 = {
    0.0: (0, 17.014064375472, -17.014064375472),
    np.pi / 36: (-9.1972619381514, 16.138959547029, -6.4278229554802),
    np.pi / 18: (-23.711839613315, 3.5571443419303, 1.8456996579779),
    np.pi / 12: (0, -10.958379606339, 10.958379606339),
}
