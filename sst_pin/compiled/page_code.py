# SPDX-License-Identifier: BSD-2-Clause
"""A robot's functions as JavaScript, for a page that computes without a server.

The equations with one choice of coordinates and pivots are valid in a part of the configurations
only. So `choices` finds several choices, and `page_code` writes the functions that do not depend on
the choice, then a set of functions for each choice. `c_statements` writes the statements of each
function in C, and `_in_javascript` translates them. engine.js calls the functions.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from casadi import SX

from ..arrays import Array
from ..dynamics.nonsmooth_rows import NonsmoothRows, motor_gains
from ..dynamics.reference import Reference
from ..errors import ClosureError, DescriptionError
from ..loops.loops import Loops
from ..loops.ranks import free_motions
from ..model.mechanism import Mechanism
from ..model.thresholds import WELL_CONDITIONED
from ..progress import announced
from ..states import StateSpace
from . import c_statements, kernels, statements
from .compiled_backend import impossible
from .equations import Equations
from .generator_inputs import sample_configurations
from .kernel_checks import Checks
from .kernels import SymbolicKernel
from .nonsmooth_kernel import NonsmoothTerms
from .nonsmooth_motions import implicit_rates, other_lines
from .symbolic_parameters import SymbolicParameters
from .symbols import column

#: Translation of a statement from C to JavaScript: patterns and what replaces them.
_TRANSLATIONS = [
    # A pair of sine and cosine.
    (
        re.compile(r"^real s(\d+), c\d+; sines_cosines\(1, &(\S+), .*"),
        r"const s\1 = Math.sin(\2), c\1 = Math.cos(\2);",
    ),
    # Types of variables.
    (re.compile(r"\bconst (?:real|number) "), "const "),
    # Literals: N(1e-3) is 1e-3f in single precision.
    (re.compile(r"\bN\(([^()]*)\)"), r"\1"),
]
#: Functions that the statements call.
_HELPERS = """\
const AT_MOST = (x, y) => x <= y ? 1 : 0, ABSOLUTE = Math.abs, SQUARE_ROOT = Math.sqrt;
const REAL = x => x;
const tangent = Math.tanh, sign = (x, rest) => x > rest ? 1 : x < -rest ? -1 : 0;
const direction = (x, width, rest) => width > 0 ? tangent(x / width) : sign(x, rest);
const rubbing = (x, F, width, rest) => F === 0 ? 0 : F * direction(x, width, rest);
"""
#: The most choices of coordinates and pivots; each of them adds its dynamics to the page.
_MOST_CHOICES = 4
#: The pivots of a choice are large enough where their check is below this; as in engine.js.
_GOOD_PIVOTS = 1e-3
# Walks through closed configurations look for choices.
#: Number of walks.
_WALKS = 6
#: Number of steps of a walk.
_STEPS = 50
#: Length of a step, [rad] or robot lengths.
_STEP = 0.1
# The direction of a step is the direction of the step before, of length one, plus two parts.
#: Size of each component of the random part.
_RANDOM = 0.1
#: Length of the part along the gravity forces.
_FALL = 0.3
#: The most statements of a function that browsers optimise.
_LARGEST = 600


def functions_of(reference: Reference, q: Array) -> tuple[str, Array]:
    """`page_code` of a robot that starts at q, and the numbers of its symbolic parameters."""
    mechanism = reference.mechanism
    equations = choices(reference, q)
    return page_code(equations), equations[0].parameters.pack(mechanism, mechanism.friction)


def choices(reference: Reference, q: Array) -> list[Equations]:
    """Equations with several choices of coordinates and pivots.

    In most configurations, the pivots of one of them are large enough. The first equations are in
    the robot's coordinates, with pivots chosen near q. Walks from q look for configurations where
    all choices so far have small pivots. There, other coordinates and pivots are chosen.
    """
    mechanism = reference.mechanism
    numbers = SymbolicParameters(mechanism).pack(mechanism, mechanism.friction)
    space = StateSpace(reference, mechanism.friction)
    equations = [_equations_near(reference, q)]
    checks = [_small_pivots(equations[0])]
    if not len(mechanism.dependent) or not len(mechanism.coordinates):
        return equations
    for configuration in _walks(space, mechanism, q):
        good_space, condition = space.in_good_coordinates(configuration)
        # The check of the choice with the largest pivots.
        check_of_best = min(float(check(configuration, numbers)) for check in checks)
        if condition < WELL_CONDITIONED and check_of_best > _GOOD_PIVOTS:
            other = Reference(replace(mechanism, coordinates=good_space.coordinates))
            equations.append(_equations_near(other, configuration))
            checks.append(_small_pivots(equations[-1]))
        if len(equations) == _MOST_CHOICES:
            break
    return equations


def _equations_near(reference: Reference, q: Array) -> Equations:
    """Equations with pivots that are chosen at samples near q."""
    # Rounded: equal legs give equal numbers up to the last digits, which must not choose pivots.
    samples = sample_configurations(reference, q).round(9)
    return Equations(reference.mechanism, samples, loaded=True)


def _small_pivots(e: Equations) -> ca.Function:
    """A function of q and the symbolic parameters: the check that is large for small pivots."""
    return ca.Function("small", [e.q, e.p], [Checks(e).small_pivots])


def _walks(space: StateSpace, mechanism: Mechanism, start: Array) -> Iterator[Array]:
    """Closed configurations along walks from a start, the same at each call.

    A step continues in the direction of the step before, with a random part and a part along the
    gravity forces. It is projected onto the motions that keep the loops closed.
    """
    model = mechanism.model
    data = model.createData()
    at_rest = np.zeros(len(mechanism.coordinates))
    random = np.random.default_rng(0)
    direction = random.standard_normal(model.nv)  # displacements of joints, free of units
    for _ in range(_WALKS):
        q = start
        for _ in range(_STEPS):
            # A basis of the motions that keep the loops closed, free of units, in its columns.
            motions = free_motions(space.Phi(q))
            fall = -pin.computeGeneralizedGravity(model, data, q) * mechanism.rate_scale
            if fall.any():
                fall = fall / np.linalg.norm(fall)
            direction = direction / np.linalg.norm(direction)
            direction = direction + _RANDOM * random.standard_normal(model.nv)
            # Projected onto these motions.
            direction = motions @ (motions.T @ (direction + _FALL * fall))
            step = _STEP * direction / np.linalg.norm(direction) * mechanism.rate_scale
            good_space, _ = space.in_good_coordinates(q)
            try:
                q = good_space.closed(np.concatenate([pin.integrate(model, q, step), at_rest]))
            except ClosureError:  # the next step goes in another direction
                direction = random.standard_normal(model.nv)
                continue
            yield q


@announced("live page: writing its equations")
def page_code(equations: Sequence[Equations]) -> str:
    """JavaScript of `sst_functions`, an object with what `engine.js` needs of a robot.

    Its members are `common`, the kernels that do not depend on the choice of coordinates; `sets`,
    the dynamics by each of the choices; and `nonsmooth`, the numbers for `nonsmooth.js`, or null
    for a robot without contacts and ropes. With contacts or ropes, each set has a kernel "terms".
    The kernel "torques" is missing if the motors do not act on all coordinates.

    A kernel is an object with the sizes of its arrays (x, y and w as in `c_statements` and
    `statements.in_parts`), `constants(p)`, which completes the symbolic parameters, and `parts`,
    functions of x, p, y, w that run one after the other.
    """
    first = equations[0]
    if problem := impossible(first.mechanism, "accelerations"):
        raise DescriptionError("a page that answers", [problem])
    has_contacts = not first.mechanism.contacts.none

    common_kernels = list(_common(first))
    if first.driven:
        # `kernels.make` adds "_loaded" to the name; the page uses the name of the quantity.
        common_kernels.append(replace(kernels.make(first, "torques"), name="torques"))
    # All functions stand in one scope: their names begin with f0, or fi for set i = 1, 2, ...
    common = _functions(common_kernels, "f0")
    sets = [_set(e, f"f{i}", has_contacts) for i, e in enumerate(equations, start=1)]
    definitions = "".join(code.definitions for code in (common, *sets))
    listed_sets = ", ".join(code.literal for code in sets)
    elements = json.dumps(_elements(first)) if has_contacts else "null"
    result = f"{{common: {common.literal}, sets: [{listed_sets}], nonsmooth: {elements}}}"
    code = f"{_HELPERS}{definitions}return {result};"
    return f"const sst_functions = (() => {{\n{code}\n}})();\n"


def _set(e: Equations, prefix: str, has_contacts: bool) -> "_Code":
    """The dynamics by one choice of coordinates and pivots; names begin with the prefix."""
    mechanism = e.mechanism
    kernels_of_set = _dynamics(e)
    layout = "null"
    if has_contacts:
        terms = NonsmoothTerms(e, _rows_of_steps(mechanism))
        kernels_of_set.append(replace(terms.kernel(Checks(e)), name="terms"))
        scale = mechanism.rate_scale[mechanism.coordinates].tolist()
        layout = json.dumps(asdict(terms.layout) | {"coordinate_scale": scale})
    of_kernels = _functions(kernels_of_set, prefix)
    members = {
        "coordinates": mechanism.coordinates.tolist(),
        "parts": _parts(mechanism),
        "layout": layout,
        "kernels": of_kernels.literal,
    }
    listed = ", ".join(f"{name}: {member}" for name, member in members.items())
    return _Code(of_kernels.definitions, literal=f"{{{listed}}}")


def _dynamics(e: Equations) -> list[SymbolicKernel]:
    """The kernels of direct dynamics by one choice of coordinates and pivots.

    Their names are those in engine.js, without "_loaded".
    """
    state_rate = replace(kernels.make(e, "state_rate"), name="state_rate")
    closing = replace(kernels.make(e, "closing"), name="closing")
    q_dot = e.kinematics.q_rates(e.v)
    v = column(e.v, range(e.mechanism.model.nv))
    rates = _kernel(e, "rates", {"q": e.q, "va": e.va}, q_dot, v)
    return [state_rate, closing, rates]


def _rows_of_steps(mechanism: Mechanism) -> NonsmoothRows:
    """The rows of a nonsmooth step, without gains: the page has its own gains of the motors."""
    return NonsmoothRows(mechanism, motor_gains(None, None, mechanism.motor_count))


def _elements(e: Equations) -> dict[str, Any]:
    """Numbers for `nonsmooth.js`: contacts, ropes, cables, stops, dry friction, implicit forces."""
    mechanism = e.mechanism
    rows = _rows_of_steps(mechanism)
    rates = implicit_rates(e.parameters)
    others = other_lines(rows)
    lines = mechanism.lines
    damping = [*mechanism.friction.viscous[rates], *lines.damping[others]]
    stiffness = [*mechanism.springs.stiffness[rates], *lines.stiffness[others]]
    return {
        "contacts": [
            {"friction": x.friction, "restitution": x.restitution, "radius": x.radius}
            for x in mechanism.contacts.points
        ],
        "ropes": [rope.length for rope in mechanism.contacts.ropes],
        "cables": [
            {
                "stiffness": float(lines.stiffness[k]),
                "rest": float(lines.rest_lengths[k]),
                "damping": float(lines.damping[k]),
                "preload": float(lines.preload[k]),
                "shares": lines.actuation[k].tolist(),
            }
            for k in rows.cables
        ],
        "stops": [{"position": x.position, "side": x.side, "limit": x.limit} for x in rows.stops],
        "dry": rows.dry_friction.tolist(),
        "gap_scale": rows.gap_scale.tolist(),
        "damping": list(map(float, damping)),
        "stiffness": list(map(float, stiffness)),
    }


def _parts(mechanism: Mechanism) -> str:
    """The dependent rates in groups that the loops connect, as an array in JavaScript.

    Each group has its `Mechanism.usual_size`, with which its singular values are compared.
    """
    parts = []
    loops = Loops(mechanism.model, mechanism.closures)
    for rows, rates in loops.parts(mechanism.coordinates):
        size = mechanism.usual_size(rows, rates)
        parts.append(f"{{rates: {rates.tolist()}, size: {size!r}}}")
    return f"[{', '.join(parts)}]"


def _common(e: Equations) -> Iterator[SymbolicKernel]:
    """Kernels that do not depend on the choice of coordinates.

    "places" are the placements of all joints, each R column by column, then p. "flow" are their
    rates for given q_dot. "energies" are the kinetic energy for given v and the potential energy.
    "loops" is Phi free of units, row by row.
    """
    kinematics = e.kinematics
    model = e.mechanism.model
    mechanism = e.mechanism
    poses = [kinematics.pose(0, kinematics.tree.link_of[i]) for i in range(model.njoints)]
    places = ca.vertcat(*(ca.vec(ca.horzcat(R, p)) for R, p in poses))
    yield _kernel(e, "places", {"q": e.q}, places)
    q_dot = SX.sym("q_dot", model.nq)
    v = SX.sym("v", model.nv)
    yield _kernel(e, "flow", {"q": e.q, "q_dot": q_dot}, ca.jtimes(places, e.q, q_dot))
    kinetic = e.tree.kinetic_energy(dict(enumerate(ca.vertsplit(v))))
    yield _kernel(e, "energies", {"q": e.q, "v": v}, kinetic, e.tree.potential_energy)
    scales = zip(e.rows, mechanism.row_scale, strict=True)
    units = SX(mechanism.rate_scale)
    Phi = (column(row.Phi, range(model.nv)) * scale * units for row, scale in scales)
    yield _kernel(e, "loops", {"q": e.q}, *Phi)


def _kernel(e: Equations, name: str, inputs: dict[str, SX], *results: Any) -> SymbolicKernel:
    """A kernel without checks."""
    return SymbolicKernel(
        name=name,
        inputs=inputs,
        parameters=e.p,
        output=ca.densify(ca.vertcat(*map(SX, results))),
        checks=SX(0, 1),
    )


class _Code(NamedTuple):
    """JavaScript of several kernels."""

    #: The definitions of their functions.
    definitions: str
    #: An object literal that refers to these functions.
    literal: str


def _functions(some_kernels: Sequence[SymbolicKernel], prefix: str) -> _Code:
    """JavaScript of kernels; the literal has a member for each kernel, by its name.

    Names of functions begin with the prefix.
    """
    definitions = []
    members = []
    for kernel in some_kernels:
        text, member = _function(kernel, f"{prefix}_{kernel.name}")
        definitions.append(text)
        members.append(member)
    return _Code("".join(definitions), "{" + ", ".join(members) + "}")


def _function(kernel: SymbolicKernel, name: str) -> tuple[str, str]:
    """Definitions of a kernel's functions, whose names begin with `name`, and its member."""
    writer = c_statements.written(kernel)
    of_parameters = list(map(_in_javascript, writer.lines[c_statements.OF_PARAMETERS]))
    of_sample = list(map(_in_javascript, writer.lines[c_statements.OF_SAMPLE]))
    parts, room = statements.in_parts(statements.pieces(of_sample, _LARGEST))
    texts = [statements.function(f"function {name}_constants(p)", of_parameters)]
    for k, part in enumerate(parts):
        texts.append(statements.function(f"function {name}_{k}(x, p, y, w)", part))
    sizes: dict[str, Any] = {
        "inputs": [x.numel() for x in kernel.inputs.values()],
        "output": kernel.output.numel(),
        "checks": kernel.checks.numel(),
        "size": writer.p_size,
        "room": room,
    }
    functions = ", ".join(f"{name}_{k}" for k in range(len(parts)))
    listed_sizes = json.dumps(sizes)[1:-1]  # without braces
    members = f"{listed_sizes}, constants: {name}_constants, parts: [{functions}]"
    return "".join(texts), f"{kernel.name}: {{{members}}}"


def _in_javascript(line: str) -> str:
    """A statement in C as JavaScript."""
    for pattern, words in _TRANSLATIONS:
        line = pattern.sub(words, line)
    return line
