# SPDX-License-Identifier: BSD-2-Clause
"""Any robot as C99 for its own controller: no allocation, no library; some need C's `sqrt`.

Most functions of the exported C evaluate a kernel (`_of_kernel`). The others are templates, files
of the folder `c/export`, whose blanks get the numbers of the robot (`_of_template`).
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ..arrays import Array, require_word
from ..dynamics.quantities import Name
from ..engine import Robot, require_robot
from ..errors import DescriptionError, MissingExtraError
from ..files import Writer, as_path, text_writer, write_files
from ..model.mechanism import Mechanism
from ..model.tree import joint_id

try:
    import casadi as ca
    from casadi import SX

    from . import c_code, kernels
except ImportError:
    raise MissingExtraError("casadi", "compile") from None
from .c_code import STYLES, Style
from .compiled_backend import impossible
from .equations import Equations
from .generator_inputs import sample_configurations
from .kernel_checks import Checks
from .symbolic_parameters import BODY, LINE, SymbolicParameters

#: Numbers of the exported C.
Precision = Literal["double", "single"]


class _CFunction(NamedTuple):
    """A function of the exported C."""

    #: Its declaration with its meaning, or a comment that says why there is no such function.
    declaration: str
    #: Empty if there is no such function.
    definition: str = ""


class _KernelFunction(NamedTuple):
    """What the function of a kernel computes."""

    kernel: Name
    #: Name of the argument that gets the result.
    output: str
    meaning: str


class _Array(NamedTuple):
    """An argument of a function in C: an array of numbers."""

    name: str
    size: int


_FORCES = "Generalized forces along the coordinates of a motion."
_JACOBIAN = (
    "J, row by row: the rates of the motors are J va, and torques tau give the forces J^T tau."
)
_STEP = """\
A step of Newton's method that closes the loops and keeps the coordinates. Start with
 * measured coordinates and the previous q of the other joints, and call it with
 * q_next = q until it returns 0. ROBOT_OPEN: the loops were open before the step."""
#: The statements of `robot_computed_torque` that compute torques, without surplus motors.
_SMALLEST = "const int bad = robot_torques(q, va, aa, tau);"
#: The same statements with surplus motors: torques within the limits, if there are such torques.
#: `limits` has the largest torque of each motor, and `both` its least and its largest torque. COUNT
#: is the number of motors.
_WITHIN_LIMITS = """\
for (int i = 0; i < COUNT; i++) {
        both[2 * i] = -limits[i];
        both[2 * i + 1] = limits[i];
    }
    int bad = robot_limited_torques(q, va, aa, both, tau);
    if (bad)
        bad = robot_torques(q, va, aa, tau);"""
#: Functions that evaluate kernels, by their names without "robot_".
_FUNCTIONS = {
    "torques": _KernelFunction("torques", "tau", "Torques of a motion."),
    "forces": _KernelFunction("generalized_forces", "f", _FORCES),
    "accelerations": _KernelFunction(
        "accelerations", "aa", "Accelerations of the coordinates by torques."
    ),
    "actuator_jacobian": _KernelFunction("actuator_jacobian", "J", _JACOBIAN),
    "assembly_step": _KernelFunction("closing", "q_next", _STEP),
}


def write_c(
    chain: Robot, folder: str | Path, precision: Precision = "double", *, force: bool = False
) -> None:
    """Write C99 code that computes a robot's dynamics without Python: robot.h, robot.c, main.c.

    robot.h declares `robot_torques` and `robot_computed_torque` (`robot_forces` where the motors do
    not hold all coordinates), `robot_accelerations`, `robot_actuator_jacobian` and
    `robot_assembly_step`, if the robot has them; with more motors than coordinates also
    `robot_limited_torques`; where each motor acts on one line, `robot_line_lengths` and
    `robot_unstretched_lengths`. main.c is an example.

    Args:
        chain: The robot.
        folder: Where the files go.
        precision: "double", or "single": seven digits, loops closed within 1e-4.
        force: Whether existing files may be replaced.

    Raises:
        DescriptionError: For a joint without compiled equations.
        ClosureError: When no configuration can be assembled, by which to choose pivots.
        InputError: For another precision.
        MissingExtraError: Without CasADi, `sst-pin[compile]`.
        OutputError: If a file cannot be written, or exists.

    Example:
        >>> sst_pin.write_c(sst_pin.robots.four_bar(), "controller")
        >>> sorted(path.name for path in Path("controller").iterdir())
        ['main.c', 'robot.c', 'robot.h']
    """
    require_robot("chain", chain)
    write_files(c_files(chain, folder, precision), force, folder=as_path(folder))


def c_files(
    chain: Robot, folder: str | Path, precision: Precision = "double"
) -> dict[Path, Writer]:
    """Writers of the files of `write_c`."""
    require_word("precision", precision, STYLES)
    engine = chain.engine
    style = STYLES[precision]
    mechanism = engine.mechanism
    q = engine.loops.example()
    equations = Equations(mechanism, sample_configurations(engine.reference, q))
    numbers = equations.parameters.pack(mechanism, mechanism.friction)
    inverse_dynamics = "torques" if equations.driven else "forces"
    functions = list(_functions(equations, inverse_dynamics, style))
    blanks = _blanks_of_header_and_example(mechanism, q, inverse_dynamics, style)
    blanks["parameters"] = len(numbers)
    blanks["functions"] = "\n".join(function.declaration for function in functions)
    folder = as_path(folder)
    return {
        folder / "robot.h": text_writer(c_code.filled("export/robot.h", blanks)),
        folder / "robot.c": text_writer(_source(functions, equations, numbers, style)),
        folder / "main.c": text_writer(c_code.filled("export/main.c", blanks)),
    }


def _source(
    functions: Sequence[_CFunction], equations: Equations, numbers: Array, style: Style
) -> str:
    """The text of robot.c; `numbers` are the values of the symbolic parameters."""
    code = "\n".join(function.definition for function in functions if function.definition)
    listed = "\n".join(_listed(equations.parameters, equations.mechanism, numbers, style.suffix))
    parts = [
        '#include "robot.h"\n',
        "#include <math.h>\n" if "SQUARE_ROOT(" in code else "",
        style.head + c_code.part("real.h"),
        f"{style.type} robot_parameters[{len(numbers)}] = {{\n{listed}\n}};\n",
        code,
    ]
    return "\n".join(parts)


def _functions(equations: Equations, inverse_dynamics: str, style: Style) -> Iterator[_CFunction]:
    """All functions of robot.c; `inverse_dynamics` is "torques" or "forces"."""
    mechanism = equations.mechanism
    checks = Checks(equations, style.closed, style.rounding)
    for name in (inverse_dynamics, "accelerations", "actuator_jacobian", "assembly_step"):
        function = _FUNCTIONS[name]
        if problem := impossible(mechanism, function.kernel):
            why = str(DescriptionError("compiled kernels", [problem]))
            yield _CFunction(f"/* There is no robot_{name}: {_comment(why)} */\n")
        else:
            kernel = kernels.make(equations, function.kernel, checks)
            yield _of_kernel(name, kernel, style, function.output, function.meaning)
    if inverse_dynamics == "torques":
        if _has_surplus(mechanism):
            yield _limited_torques(mechanism, style)
        yield _computed_torque(mechanism, style)
    if len(mechanism.motor_lines) and (mechanism.motor_lines >= 0).all():
        lengths = _line_lengths(equations, checks)
        meaning = "Lengths of the lines of the motors."
        yield _of_kernel("line_lengths", lengths, style, "lengths", meaning)
        yield _unstretched_lengths(mechanism, style)


def _head(name: str, inputs: Sequence[_Array], output: _Array, style: Style) -> str:
    """The head of a function in C: its name and its arguments. Empty inputs are left out."""
    arguments = [f"const {style.type} {x.name}[{x.size}]" for x in inputs if x.size]
    arguments.append(f"{style.type} {output.name}[{output.size}]")
    return f"int robot_{name}({', '.join(arguments)})"


def _of_template(
    head: str, meaning: str, template: str, blanks: Mapping[str, object]
) -> _CFunction:
    """A function whose C is a template of the folder `c/export`."""
    return _CFunction(
        declaration=f"/* {meaning} */\n{head};\n",
        definition=c_code.filled(f"export/{template}", {"head": head, **blanks}),
    )


def _has_surplus(mechanism: Mechanism) -> bool:
    """Whether there are more motors than coordinates, so that torques can be chosen."""
    return len(mechanism.motor_names) > len(mechanism.coordinates)


def _limited_torques(mechanism: Mechanism, style: Style) -> _CFunction:
    """`compute_torques(limits=)` in C."""
    n = len(mechanism.coordinates)
    motors = len(mechanism.motor_names)
    inputs = [
        _Array("q", mechanism.model.nq),
        _Array("va", n),
        _Array("aa", n),
        _Array("limits", 2 * motors),
    ]
    head = _head("limited_torques", inputs, _Array("tau", motors), style)
    units = mechanism.rate_scale[mechanism.coordinates].tolist()
    double = style.type == "double"
    blanks = {
        "type": style.type,
        "n": n,
        "motors": motors,
        "units": ", ".join(f"{x!r}{style.suffix}" for x in units),
        # The matrix of Newton's method is a sum over the motors that are within their limits. It is
        # singular if these are too few. So this fraction of |J|^2 is added to its diagonal.
        "least_pivot": "1e-12" if double else "1e-6f",
        # Largest error of a force, relative to the sum of the sizes of its terms. It is well above
        # rounding.
        "tolerance": "1e-11" if double else "1e-5f",
        # Halvings of the interval of a bisection: a few more than a number has bits.
        "halvings": 60 if double else 30,
    }
    meaning = (
        "Torques within limits of a motion, for surplus motors: the smallest ones, or those\n"
        " * nearest to them. limits: the least and the largest torque of each motor, in pairs."
    )
    return _of_template(head, meaning, "limited_torques.c", blanks)


def _line_lengths(equations: Equations, checks: Checks) -> kernels.SymbolicKernel:
    """The kernel of the lengths of the motors' lines."""
    lines = equations.tree.lines
    lengths = [SX(lines[k].length) for k in equations.mechanism.motor_lines]
    return kernels.SymbolicKernel(
        name="line_lengths",
        inputs={"q": equations.q},
        parameters=equations.p,
        output=ca.densify(ca.vertcat(*lengths)),
        checks=ca.vertcat(*map(SX, checks.of_state)),
    )


def _unstretched_lengths(mechanism: Mechanism, style: Style) -> _CFunction:
    """`control.unstretched_lengths` in C."""
    motors = len(mechanism.motor_names)
    inputs = [
        _Array("q", mechanism.model.nq),
        _Array("tau", motors),
        _Array("stiffness", motors),
    ]
    head = _head("unstretched_lengths", inputs, _Array("lengths", motors), style)
    factors = mechanism.lines.actuation[mechanism.motor_lines, np.arange(motors)].tolist()
    blanks = {
        "type": style.type,
        "motors": motors,
        "factors": ", ".join(f"{x!r}{style.suffix}" for x in factors),
        # A negative tension below this part of the largest one is rounding of zero.
        "slack": "1e-9" if style.type == "double" else "1e-5f",
    }
    meaning = (
        "Lengths of the motors' cables without tension, which winches must unwind, for torques\n"
        " * with which all cables pull. stiffness: that of 1 m of each cable, positive, [N]."
    )
    return _of_template(head, meaning, "unstretched_lengths.c", blanks)


def _blanks_of_header_and_example(
    mechanism: Mechanism, q: Array, inverse_dynamics: str, style: Style
) -> dict[str, object]:
    """Texts and numbers for the blanks of robot.h and main.c; q is the example in main.c."""
    n = len(mechanism.coordinates)
    motors = len(mechanism.motor_names)
    of_both: dict[str, object] = {
        "type": style.type,
        "robot": _comment(mechanism.model.name),
        "nq": len(q),
        "n": n,
    }
    of_header: dict[str, object] = {
        "closed": f"{style.closed:g}",
        "angle": f"{style.angle:g}",
        "motors": motors,
        "q_names": _comment(", ".join(mechanism.space.position_names)),
        "coordinates": _comment(", ".join(mechanism.coordinate_rate_names)),
        "motor_names": _comment(", ".join(mechanism.motor_names)),
    }
    # main.c reads motions, a line for each: q, va, aa.
    motion_at_rest = [*np.asarray(q).tolist(), *[0] * (2 * n)]
    of_example: dict[str, object] = {
        "name": inverse_dynamics,
        "meaning": _FUNCTIONS[inverse_dynamics].meaning.removesuffix("."),
        "inputs": len(motion_at_rest),
        "outputs": motors if inverse_dynamics == "torques" else n,
        "digits": style.digits,
        "example": " ".join(map(repr, motion_at_rest)),
    }
    return of_both | of_header | of_example


def _of_kernel(
    name: str, kernel: kernels.SymbolicKernel, style: Style, output: str, meaning: str
) -> _CFunction:
    """The function that evaluates a kernel; `output` is the name of its result."""
    inputs = [_Array(x, symbols.numel()) for x, symbols in kernel.inputs.items()]
    nq = kernel.inputs["q"].numel()
    results = kernel.output.numel()
    # A closing step returns q only, which comes first in the result of the kernel.
    returned = nq if output == "q_next" else results
    head = _head(name, inputs, _Array(output, returned), style)

    # Statements that copy the arguments to the array x of the kernel, one after the other.
    copies = []
    start = 0
    for name_of_input, size in inputs:
        if size:
            loop = f"    for (int i = 0; i < {size}; i++)"
            copies.append(f"{loop}\n        x[{start} + i] = {name_of_input}[i];")
        start += size

    source = c_code.body(kernel, suffix=style.suffix)
    blanks = {
        "head": head,
        "name": kernel.name,
        "type": style.type,
        "inputs": start,
        "angles": nq,
        "copies": "\n".join(copies),
        "output": output,
        "outputs": returned,
        "parameters": kernel.parameters.numel(),
        "p_size": source.p_size,
        "y_size": source.y_size,
        "checks": results,  # the index of the first check
        "total": results + kernel.checks.numel(),  # the number of results and checks
    }
    return _CFunction(
        declaration=f"/* {meaning} */\n{head};\n",
        definition=f"{source.text}\n\n{c_code.filled('export/function.c', blanks)}",
    )


def _computed_torque(mechanism: Mechanism, style: Style) -> _CFunction:
    """`ComputedTorque` in C."""
    model = mechanism.model
    joints = [model.joints[joint_id(model, name)] for name in mechanism.coordinate_names]
    if any((joint.nq, joint.nv) != (1, 1) for joint in joints):
        why = "a coordinate is no single number of q"
        return _CFunction(f"/* There is no robot_computed_torque: {why} */\n")
    n = len(joints)
    motors = len(mechanism.motor_names)
    inputs = [_Array("q", model.nq)]
    inputs += [_Array(name, n) for name in ("va", "x", "v", "a", "kp", "kd")]
    inputs.append(_Array("limits", motors))
    head = _head("computed_torque", inputs, _Array("tau", motors), style)
    blanks = {
        "type": style.type,
        "n": n,
        "motors": motors,
        "places": ", ".join(str(joint.idx_q) for joint in joints),
        # 1 for an angle, whose full turns count as no error, else 0.
        "turns": ", ".join(str(int(unit == "rad")) for unit in mechanism.coordinate_rate_units),
        "turn": f"{2 * np.pi!r}{style.suffix}",
        "half": f"0.5{style.suffix}",
        "torques": _SMALLEST,
    }
    if _has_surplus(mechanism):
        declaration = f"{style.type} both[{2 * motors}];\n    "
        blanks["torques"] = declaration + _WITHIN_LIMITS.replace("COUNT", str(motors))
    meaning = (
        "Torques that follow a motion with feedback: errors e of the coordinates obey\n"
        " * e'' + kd e' + kp e = 0 for the model. x, v, a: wanted positions, rates and\n"
        " * accelerations of the coordinates; full turns count as no error. limits: the largest\n"
        " * torques of the motors."
    )
    return _of_template(head, meaning, "computed_torque.c", blanks)


def _listed(
    parameters: SymbolicParameters, mechanism: Mechanism, numbers: Array, suffix: str
) -> Iterator[str]:
    """Lines of the symbolic parameters, each with its index and meaning."""
    space = mechanism.space
    forces = mechanism.lines.forces
    # A line of the C for each group of parameters, in the order of `SymbolicParameters`: how many
    # they are, and their meaning.
    lines = [(3, "gravity, base axes"), (1, "rate within which friction is tanh, not sign")]
    moments = "mass, first moment, second moments xx, xy, xz, yy, yz, zz in its joint's frame"
    for i in parameters.bodies:
        lines.append((BODY, f"{mechanism.model.names[i]}: {moments}"))
    for quantity, indices in parameters.joints.items():
        names = space.position_names if quantity == "spring_reference" else space.rate_names
        for k in indices:
            lines.append((1, f"{quantity.replace('_', ' ')} of {names[k]}"))
    for force in forces:
        lines.append((LINE, f"line {force}: stiffness, rest length, damping, preload"))
    for k in parameters.massive_lines:
        lines.append((1, f"line {forces[k]}: mass"))
    for k in parameters.dry_lines:
        lines.append((1, f"line {forces[k]}: dry friction"))
    assert sum(size for size, _ in lines) == len(numbers), "a parameter has no line"
    start = 0
    for size, meaning in lines:
        listed = ", ".join(repr(x) + suffix for x in numbers[start : start + size].tolist())
        yield f"    /* {start}: {_comment(meaning)} */\n    {listed},"
        start += size


def _comment(text: str) -> str:
    """Names as text of a C comment, without its end, line breaks and trigraphs."""
    plain = " ".join(text.split()).replace("\\", "/").replace("??", "? ?")
    return plain.replace("*/", "* /").replace("/*", "/ *")
