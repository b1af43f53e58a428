# SPDX-License-Identifier: BSD-2-Clause
"""What can go wrong, by name; every error derives from `SSTError` and carries its data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any


def _restore(kind: type[SSTError], args: tuple[Any, ...], data: dict[str, Any]) -> SSTError:
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(data)
    return error


class SSTError(Exception):
    """Base of every error this package raises.

    Attributes:
        samples: Indices of the samples at fault in the batch of the call, empty for a single one.
    """

    samples: tuple[tuple[int, ...], ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:  # survives the way back from a worker process
        return _restore, (type(self), self.args, self.__dict__)

    def name_samples(self, samples: Sequence[tuple[int, ...]], total: int) -> None:
        """Tell which samples of a batch failed; the message and data are those of the first."""
        self.samples = tuple(samples)
        shown = ", ".join(str(list(s))[1:-1] if len(s) == 1 else str(s) for s in samples[:5])
        more = ", ..." if len(samples) > 5 else ""
        self.args = (f"{len(samples)} of {total} samples (index {shown}{more}): {self.args[0]}",)


class InputError(SSTError, ValueError):
    """An argument has the wrong shape, is not finite, or contradicts another one.

    Attributes:
        name: The argument.
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name


class ParametersError(SSTError, ValueError):
    """Parameters that no real robot can have.

    Attributes:
        problems: All of them, one sentence each.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__("impossible parameters:\n  " + "\n  ".join(self.problems))


class DescriptionError(SSTError):
    """A robot description (URDF, YAML cuts, MJCF) that does not describe what is needed.

    Attributes:
        problems: All of them, one sentence each.
    """

    def __init__(self, source: str, problems: Iterable[str]) -> None:
        self.problems = list(problems)
        super().__init__(f"{source}:\n  " + "\n  ".join(self.problems))


class UnknownNameError(SSTError, KeyError):
    """A joint, frame or column that is not there.

    Attributes:
        name: What was asked for.
        known: What there is.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.name, self.known = name, list(known)
        super().__init__(f"{kind} {name!r} not in the model; known: {', '.join(self.known)}")

    def __str__(self) -> str:  # KeyError would show the repr
        return str(self.args[0])


class ActuationError(SSTError):
    """Coordinates that do not describe the motion, or motors that cannot bring it about.

    Attributes:
        missing: Forces that nobody supplies, by the name of the coordinate, [N m] or [N].
    """

    def __init__(self, problem: str, missing: Mapping[str, float] | None = None) -> None:
        super().__init__(problem)
        self.missing = dict(missing or {})


class ClosureError(SSTError):
    """Closures that are open, or that cannot be closed.

    Attributes:
        residual: Largest entry of the closure residual, [m] or [rad].
    """

    def __init__(self, problem: str, residual: float) -> None:
        super().__init__(problem)
        self.residual = residual


class SingularConfigurationError(SSTError):
    """A configuration in which the joint rates do not determine one another.

    Attributes:
        condition_number: Of the matrix that would have to be inverted.
    """

    def __init__(self, problem: str, condition_number: float) -> None:
        condition_number = condition_number if condition_number < 1e290 else math.inf
        super().__init__(f"{problem} (condition number {condition_number:.3g})")
        self.condition_number = condition_number


class WorkspaceError(SSTError):
    """A pose that the robot cannot take."""


class SimulationError(SSTError):
    """The integration could not go on.

    Attributes:
        time: Where it stopped, [s].
    """

    def __init__(self, problem: str, time: float) -> None:
        super().__init__(f"{problem} at t = {time:.9g} s")
        self.time = time


class FileFormatError(SSTError):
    """A file whose content cannot be used.

    Attributes:
        path: The file.
        line: Line at fault, counted from 1 with the header; None when it is the whole file.
    """

    def __init__(self, path: str | Path, problem: str, line: int | None = None) -> None:
        super().__init__(f"{path}{'' if line is None else f', line {line}'}: {problem}")
        self.path, self.line = Path(path), line


class OutputError(SSTError):
    """An output that cannot be written, or that is there already.

    Attributes:
        path: The file or folder.
    """

    def __init__(self, path: str | Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = Path(path)


class MissingExtraError(SSTError, ImportError):
    """An optional dependency is not installed.

    Attributes:
        package: What is missing.
        extra: The extra of `sst_pin` that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"{package} is not installed; run: pip install 'sst-pin[{extra}]'")
        self.package, self.extra = package, extra


class CompilationError(SSTError):
    """Kernels cannot be compiled or loaded here."""


class BrowserError(SSTError):
    """There is no browser that could take a picture, or it does not start."""


class ServerError(SSTError):
    """Nothing can listen at the address that was asked for."""


class SingularityWarning(UserWarning):
    """A simulation stopped early because the robot came close to a singularity."""


class DescriptionWarning(UserWarning):
    """Issued no more: what a description says is read or refused; kept for one release."""
