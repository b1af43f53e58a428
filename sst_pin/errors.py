# SPDX-License-Identifier: BSD-2-Clause
"""Errors and warnings of the package. All errors derive from `SSTError` and contain their data."""

from __future__ import annotations

import copyreg
import math
import os
import shlex
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def install_command(extra: str = "") -> str:
    """The command that installs this package, with an extra, for the Python that runs."""
    folder = Path(__file__).resolve().parents[1]
    extras = f"[{extra}]" if extra else ""
    command = f"{shlex.quote(sys.executable or 'python')} -m pip install"
    if (folder / "setup.py").is_file():  # a clone
        place = "." if Path.cwd() == folder else str(folder)
        return f"{command} -e {shlex.quote(place + extras)}"
    return f"{command} {shlex.quote('sst-pin' + extras)}"


def warn_caller(message: str, category: type[Warning]) -> None:
    """Issue a warning that points to the line outside the package that led to it."""
    folder = str(Path(__file__).parent) + os.sep
    level = 1
    frame = sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(folder):
        frame = frame.f_back
        level += 1
    warnings.warn(message, category, stacklevel=level)


class SSTError(Exception):
    """Base class of all errors of this package.

    Attributes:
        samples: Indices of the samples of a batch that failed; empty for a single sample.

    Example:
        >>> try:
        ...     robot.inverse_kinematics(2 * np.eye(3))
        ... except sst_pin.SSTError as error:
        ...     print(error)
        pose: not a rotation matrix (|R R^T - 1| = 3, det R = 8)
    """

    samples: tuple[tuple[int, ...], ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        # Unpickles an error, for instance from a worker process, without a call of `__init__`: the
        # arguments of subclasses differ from `args`.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    def name_samples(self, samples: Sequence[tuple[int, ...]], total: int) -> None:
        """Add the samples of a batch that failed; the message and data are those of the first."""
        self.samples = tuple(samples)
        shown = ", ".join(str(list(s))[1:-1] if len(s) == 1 else str(s) for s in samples[:5])
        more = ", ..." if len(samples) > 5 else ""
        self.args = (f"{len(samples)} of {total} samples (index {shown}{more}): {self.args[0]}",)

    def name_file(self, path: str) -> None:
        """Add the file that describes the robot."""
        self.args = (f"{path}: {self.args[0]}",)


class InputError(SSTError, ValueError):
    """An argument has a wrong shape, is not finite, or contradicts another argument.

    Attributes:
        name: Name of the argument.

    Example:
        >>> robot.compute_torques(robot.home, [0, 0], [0, 0, 0])
        Traceback (most recent call last):
            ...
        sst_pin.errors.InputError: va: shape (2,), expected (..., 3)
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name


class ParametersError(SSTError, ValueError):
    """Parameters that are physically impossible.

    Attributes:
        problems: All problems, one sentence each.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__("impossible parameters:\n  " + "\n  ".join(self.problems))


class DescriptionError(SSTError):
    """A robot description (URDF, SDF, YAML, SRDF, MJCF, model) cannot be used.

    Attributes:
        problems: All problems, one sentence each.
    """

    def __init__(self, source: str, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__(f"{source}:\n  " + "\n  ".join(self.problems))


class UnknownNameError(SSTError, KeyError):
    """There is no joint, frame, parameter or other part of this name.

    Attributes:
        name: The unknown name.
        known: The known names.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.name = name
        self.known = list(known)
        super().__init__(f"{kind} {name!r} not in the model; known: {', '.join(self.known)}")

    def __str__(self) -> str:  # KeyError would show the repr
        return str(self.args[0])


class ActuationError(SSTError):
    """The motors cannot produce a motion, or cannot hold the robot.

    Attributes:
        missing: Forces that no motor supplies, for each name of a coordinate, [N m] or [N].

    Example:
        >>> lift = sst_pin.robots.five_bar()
        >>> poor = sst_pin.ClosedChain(lift.model, lift.closures, lift.motor_names[:1])
        >>> poor.compute_torques(lift.home, np.zeros(2), np.ones(2))
        Traceback (most recent call last):
            ...
        sst_pin.errors.ActuationError: the motors cannot produce this motion: ...
    """

    def __init__(self, problem: str, missing: Mapping[str, float] | None = None) -> None:
        super().__init__(problem)
        self.missing = dict(missing or {})


class IndeterminateError(SSTError):
    """A reaction that is not unique, because the robot is overconstrained.

    Attributes:
        name: Name of the joint or closure.
        components: The components of its wrench that are not unique.
    """

    def __init__(self, name: str, components: Sequence[str]) -> None:
        cure = "the robot is overconstrained; stiffness= of joints and closures makes them unique, "
        cure += "or, for forces in the plane of a planar robot, axes= along this plane"
        super().__init__(f"{name}: {', '.join(components)} are not unique: {cure}")
        self.name = name
        self.components = tuple(components)


class ClosureError(SSTError):
    """The loops are open, or cannot be closed.

    Attributes:
        residual: Largest entry of the residual, [m] or [rad].
    """

    def __init__(self, problem: str, residual: float) -> None:
        super().__init__(problem)
        self.residual = residual


class SingularConfigurationError(SSTError):
    """A singular configuration, e.g. the coordinates do not determine the other joint rates.

    Attributes:
        condition_number: Condition number of the singular matrix.

    Example:
        >>> robot.inverse_kinematics(np.eye(3))
        Traceback (most recent call last):
            ...
        sst_pin.errors.SingularConfigurationError: leg 1 is in the plane of its arc (sin ...
    """

    def __init__(self, problem: str, condition_number: float) -> None:
        condition_number = condition_number if condition_number < 1e290 else math.inf
        super().__init__(f"{problem} (condition number {condition_number:.3g})")
        self.condition_number = condition_number


class WorkspaceError(SSTError):
    """A pose that the robot cannot reach."""


class SimulationError(SSTError):
    """A simulation failed.

    Attributes:
        time: Time at which it stopped, [s].
    """

    def __init__(self, problem: str, time: float) -> None:
        super().__init__(f"{problem} at t = {time:.9g} s")
        self.time = time


class FileFormatError(SSTError):
    """A file has a wrong format.

    Attributes:
        path: The file.
        line: Number of the wrong line, starting with 1 for the header; None for the whole file.
    """

    def __init__(self, path: str | Path, problem: str, line: int | None = None) -> None:
        super().__init__(f"{path}{'' if line is None else f', line {line}'}: {problem}")
        self.path = Path(path)
        self.line = line


class OutputError(SSTError):
    """A file or folder cannot be written, or exists already.

    Attributes:
        path: The file or folder.
    """

    def __init__(self, path: str | Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = Path(path)


class MissingExtraError(SSTError, ImportError):
    """An optional package is not installed.

    Attributes:
        package: The missing package; several are separated by commas.
        extra: The extra of `sst_pin` that installs it; several are separated by commas.
    """

    def __init__(self, package: str, extra: str) -> None:
        verb = "are" if "," in package else "is"
        super().__init__(f"{package} {verb} not installed; run: {install_command(extra)}")
        self.package = package
        self.extra = extra


class CompilationError(SSTError):
    """Kernels cannot be compiled or loaded."""


class BrowserError(SSTError):
    """There is no browser for pictures, or it does not start."""


class ServerError(SSTError):
    """A server cannot use the given address or port."""


class SingularityWarning(UserWarning):
    """A simulation stopped early, close to a singularity.

    Example:
        >>> import warnings
        >>> bars = {"crank": 0.2, "rocker": 0.2, "coupler": 0.3, "ground": 0.3, "point": 0.3}
        >>> chain = sst_pin.robots.four_bar(**bars)  # a parallelogram
        >>> with warnings.catch_warnings(record=True) as caught:
        ...     motion = chain.simulate([0], chain.home, [-1], np.linspace(0, 1, 11))
        >>> caught[0].category.__name__, len(motion)
        ('SingularityWarning', 3)
    """


class DescriptionWarning(UserWarning):
    """A robot description is doubtful or incomplete, or a file format cannot store a part of it."""
