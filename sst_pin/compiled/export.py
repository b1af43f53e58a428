# SPDX-License-Identifier: BSD-2-Clause
"""Any robot as C99 for its own controller: no allocation, no library; some need C's `sqrt`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ..arrays import Array
from ..dynamics.quantities import Name
from ..engine import Robot, require_robot
from ..errors import DescriptionError, InputError, MissingExtraError
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


class _Function(NamedTuple):
    """A function of the exported C: its kernel, and the name and meaning of its result."""

    kernel: Name
    output: str
    meaning: str


_FORCES = "Generalized forces along the coordinates of a motion."
_JACOBIAN = (
    "J, row by row: the rates of the motors are J va, and torques tau give the forces J^T tau."
)
_STEP = """\
A step of Newton's method that closes the loops and keeps the coordinates. Start with
 * measured coordinates and the previous q of the other joints, and call it with
 * q_next = q until it returns 0. ROBOT_OPEN: the loops were open before the step."""
#: How `robot_computed_torque` computes torques: without surplus motors, and with them.
_SMALLEST = "const int bad = robot_torques(q, va, aa, tau);"
_WITHIN = """\
for (int i = 0; i < COUNT; i++) {
        both[2 * i] = -limits[i];
        both[2 * i + 1] = limits[i];
    }
    int bad = robot_limited_torques(q, va, aa, both, tau);
    if (bad)
        bad = robot_torques(q, va, aa, tau);"""
_FUNCTIONS = {
    "torques": _Function("torques", "tau", "Torques of a motion."),
    "forces": _Function("generalized_forces", "f", _FORCES),
    "accelerations": _Function(
        "accelerations", "aa", "Accelerations of the coordinates by torques."
    ),
    "actuator_jacobian": _Function("actuator_jacobian", "J", _JACOBIAN),
    "assembly_step": _Function("closing", "q_next", _STEP),
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
    if precision not in STYLES:
        raise InputError("precision", f"{precision!r} is not one of {', '.join(STYLES)}")
    engine = chain.engine
    style = STYLES[precision]
    mechanism = engine.mechanism
    q = engine.loops.example()
    equations = Equations(mechanism, sample_configurations(engine.reference, q))
    numbers = equations.parameters.pack(mechanism, mechanism.friction)
    dynamics = "torques" if equations.driven else "forces"
    functions = list(_functions(equations, dynamics, style))
    code = "\n".join(definition for _, definition in functions if definition)
    listed = "\n".join(_listed(equations.parameters, mechanism, numbers, style.suffix))
    source = [
        '#include "robot.h"\n',
        "#include <math.h>\n" if "SQUARE_ROOT(" in code else "",
        style.head + c_code.part("real.h"),
        f"{style.type} robot_parameters[{len(numbers)}] = {{\n{listed}\n}};\n",
        code,
    ]
    about = _about(mechanism, q, dynamics, style)
    about["size"] = len(numbers)
    about["functions"] = "\n".join(declaration for declaration, _ in functions)
    texts = {
        "robot.h": c_code.filled("export/robot.h", about),
        "robot.c": "\n".join(source),
        "main.c": c_code.filled("export/main.c", about),
    }
    return {as_path(folder) / name: text_writer(text) for name, text in texts.items()}


def _functions(equations: Equations, dynamics: str, style: Style) -> Iterator[tuple[str, str]]:
    """Declarations and definitions of all functions."""
    mechanism = equations.mechanism
    checks = Checks(equations, style.closed, style.rounding)
    for name in (dynamics, "accelerations", "actuator_jacobian", "assembly_step"):
        try:
            if problem := impossible(mechanism, _FUNCTIONS[name].kernel):
                raise DescriptionError("compiled kernels", [problem])
            kernel = kernels.make(equations, _FUNCTIONS[name].kernel, checks)
            function = _FUNCTIONS[name]
            yield _exported(name, kernel, style, function.output, function.meaning)
        except DescriptionError as error:
            yield f"/* There is no robot_{name}: {_comment(str(error))} */\n", ""
    if dynamics == "torques":
        if _has_surplus(mechanism):
            yield _limited_torques(mechanism, style)
        yield _computed_torque(mechanism, style)
    if len(mechanism.motor_lines) and (mechanism.motor_lines >= 0).all():
        meaning = "Lengths of the lines of the motors."
        lengths = _line_lengths(equations, checks)
        yield _exported("line_lengths", lengths, style, "lengths", meaning)
        yield _unstretched_lengths(mechanism, style)


def _has_surplus(mechanism: Mechanism) -> bool:
    """Whether there are more motors than coordinates, so that torques can be chosen."""
    return len(mechanism.motor_names) > len(mechanism.coordinates)


def _limited_torques(mechanism: Mechanism, style: Style) -> tuple[str, str]:
    """Declaration and definition of `compute_torques(limits=)` in C."""
    n = len(mechanism.coordinates)
    motors = len(mechanism.motor_names)
    arrays = [("q", mechanism.model.nq), ("va", n), ("aa", n), ("limits", 2 * motors)]
    inputs = ", ".join(f"const {style.type} {x}[{size}]" for x, size in arrays)
    head = f"int robot_limited_torques({inputs}, {style.type} tau[{motors}])"
    units = mechanism.rate_scale[mechanism.coordinates].tolist()
    double = style.type == "double"
    blanks = {
        "head": head,
        "type": style.type,
        "n": n,
        "motors": motors,
        "units": ", ".join(f"{x!r}{style.suffix}" for x in units),
        # Where the motors at their limits leave too few, a pivot is lifted by this part.
        "least_pivot": "1e-12" if double else "1e-6f",
        "tolerance": "1e-11" if double else "1e-5f",
        "halvings": 60 if double else 30,
    }
    meaning = (
        "Torques within limits of a motion, for surplus motors: the smallest ones, or those\n"
        " * nearest to them. limits: the least and the largest torque of each motor, in pairs."
    )
    return f"/* {meaning} */\n{head};\n", c_code.filled("export/limited_torques.c", blanks)


def _line_lengths(equations: Equations, checks: Checks) -> kernels.SymbolicKernel:
    """The kernel of the lengths of the motors' lines."""
    lines = equations.tree.lines
    lengths = [SX(lines[k].length) for k in equations.mechanism.motor_lines]
    output = ca.densify(ca.vertcat(*lengths))
    closed = ca.vertcat(*map(SX, checks.of_state))
    return kernels.SymbolicKernel("line_lengths", {"q": equations.q}, equations.p, output, closed)


def _unstretched_lengths(mechanism: Mechanism, style: Style) -> tuple[str, str]:
    """Declaration and definition of `control.unstretched_lengths` in C."""
    motors = len(mechanism.motor_names)
    arrays = [("q", mechanism.model.nq), ("tau", motors), ("stiffness", motors)]
    inputs = ", ".join(f"const {style.type} {x}[{size}]" for x, size in arrays)
    head = f"int robot_unstretched_lengths({inputs}, {style.type} lengths[{motors}])"
    factors = mechanism.lines.actuation[mechanism.motor_lines, np.arange(motors)].tolist()
    blanks = {
        "head": head,
        "type": style.type,
        "motors": motors,
        "factors": ", ".join(f"{x!r}{style.suffix}" for x in factors),
        # Tensions that are less negative, relative to the largest, are rounding of zero.
        "slack": "1e-9" if style.type == "double" else "1e-5f",
    }
    meaning = (
        "Lengths of the motors' cables without tension, which winches must unwind, for torques\n"
        " * with which all cables pull. stiffness: that of 1 m of each cable, positive, [N]."
    )
    return f"/* {meaning} */\n{head};\n", c_code.filled("export/unstretched_lengths.c", blanks)


def _about(mechanism: Mechanism, q: Array, dynamics: str, style: Style) -> dict[str, object]:
    """Texts and numbers for the header and the example."""
    n = len(mechanism.coordinates)
    motors = len(mechanism.motor_names)
    at_rest = [*np.asarray(q).tolist(), *[0] * (2 * n)]
    return {
        **style._asdict(),
        "closed": f"{style.closed:g}",
        "angle": f"{style.angle:g}",
        "robot": _comment(mechanism.model.name),
        "nq": len(q),
        "n": n,
        "motors": motors,
        "q_names": _comment(", ".join(mechanism.space.position_names)),
        "coordinates": _comment(", ".join(mechanism.coordinate_rate_names)),
        "motor_names": _comment(", ".join(mechanism.motor_names)),
        "meaning": _FUNCTIONS[dynamics].meaning.split(",")[0].removesuffix("."),
        "name": dynamics,
        "inputs": len(at_rest),
        "outputs": motors if dynamics == "torques" else n,
        "example": " ".join(map(repr, at_rest)),
    }


def _exported(
    name: str, kernel: kernels.SymbolicKernel, style: Style, output: str, meaning: str
) -> tuple[str, str]:
    """Declaration and definition of the function of a kernel, without arguments that are empty."""
    inputs = 0
    heads = []
    copies = []
    sizes = {x: symbols.numel() for x, symbols in kernel.inputs.items()}
    for x, n in sizes.items():
        if n:
            heads.append(f"const {style.type} {x}[{n}], ")
            copies.append(f"    for (int i = 0; i < {n}; i++)\n        x[{inputs} + i] = {x}[i];")
        inputs += n
    body = c_code.body(kernel, suffix=style.suffix)
    results = kernel.output.numel()
    outputs = sizes["q"] if output == "q_next" else results
    head = f"int robot_{name}({''.join(heads)}{style.type} {output}[{outputs}])"
    blanks = {
        "head": head,
        "name": kernel.name,
        "type": style.type,
        "inputs": inputs,
        "angles": sizes["q"],
        "copies": "\n".join(copies),
        "output": output,
        "outputs": outputs,
        "parameters": kernel.parameters.numel(),
        "size": body.size,
        "room": body.room,
        "checks": results,
        "total": results + kernel.checks.numel(),
    }
    text = f"{body.text}\n\n{c_code.filled('export/function.c', blanks)}"
    return f"/* {meaning} */\n{head};\n", text


def _computed_torque(mechanism: Mechanism, style: Style) -> tuple[str, str]:
    """Declaration and definition of `ComputedTorque` in C."""
    model = mechanism.model
    joints = [model.joints[joint_id(model, name)] for name in mechanism.coordinate_names]
    if any((joint.nq, joint.nv) != (1, 1) for joint in joints):
        why = "a coordinate is no single number of q"
        return f"/* There is no robot_computed_torque: {why} */\n", ""
    n = len(joints)
    motors = len(mechanism.motor_names)
    arrays = [("q", model.nq), *((name, n) for name in ("va", "x", "v", "a", "kp", "kd"))]
    arrays.append(("limits", motors))
    inputs = ", ".join(f"const {style.type} {x}[{size}]" for x, size in arrays)
    head = f"int robot_computed_torque({inputs}, {style.type} tau[{motors}])"
    blanks = {
        "head": head,
        "type": style.type,
        "n": n,
        "motors": motors,
        "places": ", ".join(str(joint.idx_q) for joint in joints),
        "turns": ", ".join(str(int(unit == "rad")) for unit in mechanism.coordinate_rate_units),
        "turn": f"{2 * np.pi!r}{style.suffix}",
        "half": f"0.5{style.suffix}",
        "torques": _SMALLEST,
    }
    if _has_surplus(mechanism):
        declared = f"{style.type} both[{2 * motors}];\n    "
        blanks["torques"] = declared + _WITHIN.replace("COUNT", str(motors))
    meaning = (
        "Torques that follow a motion with feedback: errors e of the coordinates obey\n"
        " * e'' + kd e' + kp e = 0 for the model. x, v, a: wanted positions, rates and\n"
        " * accelerations of the coordinates; full turns count as no error. limits: the largest\n"
        " * torques of the motors."
    )
    return f"/* {meaning} */\n{head};\n", c_code.filled("export/computed_torque.c", blanks)


def _listed(
    parameters: SymbolicParameters, mechanism: Mechanism, numbers: Array, suffix: str
) -> Iterator[str]:
    """Lines of the symbolic parameters, each with its index and meaning."""
    space = mechanism.space
    names = mechanism.model.names
    lines = [(3, "gravity, base axes"), (1, "rate within which friction is tanh, not sign")]
    moments = "mass, first moment, second moments xx, xy, xz, yy, yz, zz in its joint's frame"
    lines += [(BODY, f"{names[i]}: {moments}") for i in parameters.bodies]
    for quantity, where in parameters.joints.items():
        of = space.position_names if quantity == "spring_reference" else space.rate_names
        lines += [(1, f"{quantity.replace('_', ' ')} of {of[k]}") for k in where]
    numbers_of = "stiffness, rest length, damping, preload"
    lines += [(LINE, f"line {force}: {numbers_of}") for force in mechanism.lines.forces]
    masses = parameters.massive_lines
    lines += [(1, f"line {mechanism.lines.forces[k]}: mass") for k in masses]
    rubbing = parameters.dry_lines
    lines += [(1, f"line {mechanism.lines.forces[k]}: dry friction") for k in rubbing]
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
