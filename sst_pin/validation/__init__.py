# SPDX-License-Identifier: BSD-2-Clause
"""Report of all problems of a robot description, for any robot."""

from __future__ import annotations

from pathlib import Path

from ..chain.closed_chain import ClosedChain
from ..errors import ClosureError, DescriptionError, InputError
from ..files import as_path, beside
from ..reading import checks, is_mjcf, parse_urdf, parse_xml, read_text
from ..reading.problems import Problem, error
from . import inertia, loops, meshes

__all__ = ["Problem", "summary", "validate"]


def validate(path: str | Path, cuts: str | Path | None = None) -> list[Problem]:
    """All problems of a description and of its closures.

    Of a URDF it checks names, tree, limits and axes; moving links without mass; impossible
    inertias; missing meshes, and meshes that some tools cannot read. With a YAML it also checks
    unknown names, closures that cannot close, and whether there are too few or too many motors.
    Of an MJCF it checks what `ClosedChain.from_mjcf` cannot read, closures and motors; MuJoCo
    itself checks the rest.

    Args:
        path: Any URDF, or an MJCF with the ending .xml or .mjcf.
        cuts: YAML of closures and motors, see `ClosedChain.from_urdf`; by default the file with the
            name of the URDF and the ending .yaml. Without a YAML the URDF is an open tree. An MJCF
            has none.

    Returns:
        Errors first, then warnings; empty for a good description.

    Raises:
        InputError: For an MJCF with `cuts`.
        MissingExtraError: For an MJCF without MuJoCo.

    Example:
        >>> sst_pin.validate(sst_pin.URDF_PATH)
        []
    """
    if _is_mjcf(path, cuts):
        return sorted(loops.check_mjcf(as_path(path)), key=lambda problem: problem.severity)
    try:
        text = read_text(path, "URDF")
        root = parse_xml(text, str(path))
    except DescriptionError as caught:
        told = [problem.removeprefix("not a URDF: ") for problem in caught.problems]
        return [error("file", problem) for problem in told]
    path = Path(path)
    problems = list(checks.check(root))
    if not any(problem.severity == "error" for problem in problems):  # Pinocchio needs a tree
        problems += loops.check(text, path, _cuts_of(path, cuts))
    problems += [*inertia.check(root), *meshes.check(root, path.parent)]
    return sorted(problems, key=lambda problem: problem.severity)


def summary(path: str | Path, cuts: str | Path | None = None) -> str:
    """Joints, mass and mobility of a robot without errors; arguments as in `validate`."""
    path = as_path(path)
    mjcf = _is_mjcf(path, cuts)
    cuts = _cuts_of(path, cuts)
    if cuts is None and not mjcf:
        model = parse_urdf(read_text(path, "URDF"), str(path))
        mobility = f"joints              {model.njoints - 1}, an open tree: no {path.stem}.yaml"
    else:
        chain = ClosedChain.from_mjcf(path) if mjcf else ClosedChain.from_urdf(path, cuts)
        model = chain.model
        try:
            mobility = str(chain.mobility())
        except ClosureError as caught:
            mobility = str(caught)
    mass = sum(inertia.mass for inertia in list(model.inertias)[1:])
    return f"{mobility}\nmoving mass         {mass:.6g} kg"


def _is_mjcf(path: str | Path, cuts: str | Path | None) -> bool:
    mjcf = isinstance(path, (str, Path)) and is_mjcf(Path(path))
    if mjcf and cuts is not None:
        raise InputError("cuts", "an MJCF contains its closures and motors")
    return mjcf


def _cuts_of(path: Path, cuts: str | Path | None) -> Path | None:
    if cuts is not None:
        return as_path(cuts)
    own = beside(path, ".yaml")
    return own if own.is_file() else None
