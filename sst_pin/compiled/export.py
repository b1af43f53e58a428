# SPDX-License-Identifier: BSD-2-Clause
"""Any robot as C99 for its own controller: no allocation, no library but the mathematical one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..chain.closed_chain import ClosedChain
from ..errors import ActuationError
from ..files import Writer, text_writer
from . import c_code, kernels
from .backend import sample_configurations
from .equations import Equations

_HEADER = """\
/* Dynamics of the robot {robot}, by sst-pin export-c. SI units, radians.
 *
 * q[{nq}]: {q_names}
 * va[{n}], aa[{n}]: rates and accelerations of {coordinates}
 * tau[{motors}]: {motor_names}
 *
 * Each function returns 0, or 1 where its result means nothing: the loops are open, the
 * configuration is singular, or a number is not finite. */
#ifndef ROBOT_H
#define ROBOT_H

#ifdef __cplusplus
extern "C" {{
#endif

/* Gravity (base axes), a rate within which friction is tanh instead of sign (0: sign); then of each
 * body with mass ({bodies}) its mass, first moment (3) and second moments xx, xy, xz, yy, yz, zz
 * about its joint's frame; then{joints}. They may be changed between calls. */
extern double robot_parameters[{size}];

{functions}
#ifdef __cplusplus
}}
#endif

#endif
"""

_WRAPPER = """
{head}
{{
    double x[{inputs}], y[{total}], p[{size}];
    int bad = 0;
{copies}
    for (int i = 0; i < {parameters}; i++)
        p[i] = robot_parameters[i];
    prepare_{name}(p);
    {name}(x, p, y);
    for (int i = 0; i < {outputs}; i++) {{
        {output}[i] = y[i];
        bad |= !(y[i] * 0.0 == 0.0);
    }}
    for (int i = {outputs}; i < {total}; i++)
        bad |= !(y[i] <= 1.0);
    return bad;
}}
"""

_MAIN = """\
/* Torques that hold the robot {robot} at rest. Compile with: cc -std=c99 main.c robot.c -lm */
#include <stdio.h>

#include "robot.h"

int main(void)
{{
    const double q[{nq}] = {{{q}}};
    const double va[{n}] = {{0}}, aa[{n}] = {{0}};
    double tau[{motors}];
    if (robot_torques(q, va, aa, tau))
        return 1;
    for (int i = 0; i < {motors}; i++)
        printf("%.17g\\n", tau[i]);
    return 0;
}}
"""


def c_files(chain: ClosedChain, folder: str | Path) -> dict[Path, Writer]:
    """The files that compute a robot's dynamics without Python.

    Args:
        chain: The robot.
        folder: Where they go.

    Returns:
        Writers of robot.h, robot.c and main.c.

    Raises:
        DescriptionError: For a joint or spring without compiled equations.
        ClosureError: When no configuration can be assembled, by which to choose pivots.
        ActuationError: When there are fewer motors than coordinates.
    """
    q = chain.generic_configuration()
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    mechanism = chain._current.mechanism()
    model = mechanism.model
    if motors < n:
        raise ActuationError(f"{motors} motors for {n} coordinates determine no torques")
    equations = Equations(mechanism, sample_configurations(chain._current.reference))
    sizes = {"q": len(q), "va": n, "aa": n, "tau": motors}
    functions = {
        "torques": ("Torques of a motion.", ("q", "va", "aa"), "tau"),
        "accelerations": ("Accelerations under torques.", ("q", "va", "tau"), "aa"),
    }
    source = ['#include "robot.h"\n\n#include <math.h>\n', c_code.part("real.h")]
    numbers = equations.parameters.pack(mechanism, mechanism.friction)
    listed = ",\n    ".join(map(repr, numbers.tolist()))
    source.append(f"double robot_parameters[{len(numbers)}] = {{\n    {listed}\n}};\n")
    declarations = []
    for name, (meaning, inputs, output) in functions.items():
        kernel = kernels.make(equations, name)
        arguments = ", ".join(f"const double {x}[{sizes[x]}]" for x in inputs)
        head = f"int robot_{name}({arguments}, double {output}[{sizes[output]}])"
        declarations.append(f"/* {meaning} */\n{head};\n")
        copies, start = [], 0
        for x in inputs:
            copies.append(
                f"    for (int i = 0; i < {sizes[x]}; i++)\n        x[{start} + i] = {x}[i];"
            )
            start += sizes[x]
        code = c_code.body(kernel)
        source.append(code.text)
        source.append(
            _WRAPPER.format(
                head=head,
                name=kernel.name,
                size=code.size,
                parameters=len(numbers),
                inputs=start,
                outputs=sizes[output],
                output=output,
                total=sizes[output] + kernel.checks.numel(),
                copies="\n".join(copies),
            )
        )
    joints = equations.parameters.joints
    rates = mechanism.space.rate_names
    header = _HEADER.format(
        robot=_comment(model.name),
        nq=len(q),
        q_names=_comment(", ".join(chain.position_names)),
        n=n,
        coordinates=_comment(", ".join(mechanism.coordinate_rate_names)),
        motors=motors,
        motor_names=_comment(", ".join(chain.motor_names)),
        bodies=_comment(", ".join(model.names[i] for i in equations.parameters.bodies)),
        joints=_comment(
            "".join(
                f" {name} of {', '.join(rates[k] for k in where)};"
                for name, where in joints.items()
                if where
            )
            or " nothing else"
        ),
        size=len(numbers),
        functions="\n".join(declarations),
    )
    main = _MAIN.format(
        robot=_comment(model.name),
        nq=len(q),
        n=n,
        motors=motors,
        q=", ".join(map(repr, np.asarray(q).tolist())),
    )
    texts = {"robot.h": header, "robot.c": "\n".join(source), "main.c": main}
    return {Path(folder) / name: text_writer(text) for name, text in texts.items()}


def _comment(text: str) -> str:
    """Names that stand in a comment of C."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ")
