# SPDX-License-Identifier: BSD-2-Clause
"""Inputs of the generator of kernels: sample configurations, and the fingerprint for the cache."""

from dataclasses import is_dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..dynamics.nonsmooth_rows import NonsmoothRows
from ..dynamics.reference import Reference
from ..errors import ClosureError, SingularConfigurationError
from ..loops.examples import examples
from ..model.closures import frames_of
from ..model.mechanism import Mechanism
from ..model.tree import frame_named
from .links import LinkTree
from .symbolic_parameters import SymbolicParameters

#: Number of configurations by which pivots are chosen.
_SAMPLES = 8


def sample_configurations(reference: Reference, near: Array | None = None) -> Array:
    """Assembled configurations by which pivots are chosen, shape (samples, nq).

    They are the same at each call. The first one is `near`, by default the robot's example; the
    others are close to it or to one another.

    Raises:
        ClosureError: If `near` does not close the loops, or no configuration can be assembled.
        SingularConfigurationError: If the first configuration is singular.
    """
    reference.mechanism.require_freedom()
    assembly = reference.context.assembly
    is_default = near is None
    if near is None:
        near = reference.mechanism.example
    if near is None:
        near = next(examples(assembly))
    try:
        # Refuses open loops and singular configurations.
        reference.rates(near, np.zeros(len(reference.mechanism.coordinates)))
    except SingularConfigurationError as error:
        if is_default:
            cure = "in another assembly mode give q: compile(q), casadi(q)"
            error.args = (f"{error.args[0]}; {cure}",)
        raise
    samples = [near]
    for seed in range(4 * _SAMPLES):
        start = samples[seed % len(samples)]
        try:
            samples.append(assembly.aside(start, seed))  # a configuration beside `start`
        except ClosureError:
            continue
        if len(samples) == _SAMPLES:
            break
    return np.array(samples)


def fingerprint(
    mechanism: Mechanism,
    parameters: SymbolicParameters,
    near: Array | None,
    frame: str | None = None,
    rows: NonsmoothRows | None = None,
) -> bytes:
    """All that kernels are made from, exactly; equal fingerprints mean equal code.

    It is a part of the names of files in the cache. Closures and lines name frames, so it has the
    placements of these frames.

    Args:
        mechanism: The mechanism.
        parameters: Its symbolic parameters. Their values are no part of the code.
        near: The configuration near which pivots are chosen; by default the example.
        frame: Name of the frame, for a quantity of a frame.
        rows: The rows of a nonsmooth step.
    """
    model = mechanism.model
    lines = [(x.frame_a, x.frame_b) for x in mechanism.lines.forces]
    named = set[str]()  # names of frames
    for closure in mechanism.closures:
        named.update(frames_of(closure))
    for ends in lines:
        named.update(ends)
    if frame is not None:
        named.add(frame)
    of_rows: dict[str, Any] = {}
    if rows is not None:
        contacts = mechanism.contacts
        points = [(x.frame, x.ground) for x in contacts.points]
        ropes = [(x.frame_a, x.frame_b) for x in contacts.ropes]
        of_rows = {
            "contacts": points,
            "ropes": ropes,
            "radii": [x.radius for x in contacts.points],
            "stops": [(x.rate, x.position, x.side) for x in rows.stops],
            "dry rates": rows.dry_rates,
            "dry lines": rows.dry_lines,
            "cables": rows.cables,
        }
        for ends in (*points, *ropes):
            named.update(ends)
    of_cables: dict[str, Any] = {}
    if mechanism.lines.pull_only.any():
        of_cables = {
            "pull only": mechanism.lines.pull_only,
            # The potential energy of a cable has another formula if the cable has a spring.
            "stiff": mechanism.lines.stiffness > 0,
        }
    frames = {name: frame_named(model, name) for name in sorted(named)}
    if near is None:
        near = mechanism.example
    if near is not None:
        # Rounded, because the last digits of an assembled configuration may vary; -0 becomes 0.
        near = near.round(6) + 0.0
    parts = {
        "tree": LinkTree.of(model),
        "joints": list(model.names),
        "indices": [(x.idx_q, x.idx_v) for x in model.joints],
        "frames": {name: (x.parentJoint, x.placement.homogeneous) for name, x in frames.items()},
        "closures": mechanism.closures,
        "lines": lines,
        "motors on lines": mechanism.lines.actuation,
        "cables": of_cables,
        "coordinates": mechanism.coordinates,
        "motors on joints": mechanism.actuation,
        "scales": (mechanism.row_scale, mechanism.rate_scale, mechanism.length),
        "parameters": vars(parameters),
        # External wrenches act at mass centres. Of bodies without symbolic masses, the mass centre
        # is a number in the code.
        "levers": [x.lever for i, x in enumerate(model.inertias) if i not in parameters.bodies],
        "frame": frame,
        "near": near,
        "nonsmooth rows": of_rows,
    }
    if mechanism.weight_shares is not None:
        parts["weight shares"] = mechanism.weight_shares
    return _exact(parts).encode()


def _exact(x: Any) -> str:
    """A value as text, to the last bit."""
    if isinstance(x, np.ndarray):
        return f"{x.dtype} {x.shape} {x.tobytes().hex()}"
    if is_dataclass(x):
        return f"{type(x).__name__} {_exact(vars(x))}"
    if isinstance(x, dict):
        return _exact(list(x.items()))
    if isinstance(x, (list, tuple)):
        return f"({', '.join(map(_exact, x))})"
    return repr(x)
