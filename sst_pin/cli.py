# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin`."""

from __future__ import annotations

import argparse
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from .errors import FileFormatError, SingularityWarning, SSTError
from .export import c_files
from .files import Table, Writer, read_table, write_files
from .motion_files import MOTORS, read_motion
from .paper import PERIOD, compare, example_1, example_2
from .sst import SST
from .trajectories import Trajectory

Array = NDArray[np.float64]


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")  # one line, the usage is in --help


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments; those of the process by default.

    Returns:
        The exit code: 0, or 2 after one line that says what is wrong.
    """
    arguments = _parser().parse_args(argv)
    try:
        with warnings.catch_warnings():
            # A motion that stops early is told on standard output, once.
            warnings.simplefilter("ignore", SingularityWarning)
            arguments.run(arguments)
    except SSTError as error:
        print(f"sst-pin: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("sst-pin: interrupted", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="sst-pin", description="Dynamics of the SST spherical parallel manipulator."
    )
    parser.add_argument("--version", action="version", version=_version("sst-pin"))
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)

    def command(name: str, run: Callable[[argparse.Namespace], None], text: str) -> _Parser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run)
        sub.add_argument(
            "--urdf", type=Path, metavar="FILE", help="an edited URDF; the paper's robot by default"
        )
        return sub

    paper = command("paper", _paper, "Compute the paper's two examples and draw its figures.")
    paper.add_argument("--out", type=Path, default=Path("paper"), help="folder (default: paper)")
    paper.add_argument(
        "--samples", type=_count, default=1001, metavar="N", help="samples a period (default: 1001)"
    )
    paper.add_argument("--force", action="store_true", help="replace files that are there")

    torques = command(
        "torques",
        _torques,
        "Motor torques of a motion: t_s with qw, qx, qy, qz, or theta, phi, psi, or gamma_1..3 "
        "(angles end in _rad or _deg).",
    )
    torques.add_argument("motion", type=Path, metavar="MOTION.csv")
    _output(torques, "TORQUES.csv")

    simulate = command(
        "simulate",
        _simulate,
        "Motion under given torques: t_s with tau_1_Nm, tau_2_Nm, tau_3_Nm. It starts from the "
        "first row where that has gamma_1_rad.. and gamma_1_rad_s.., else from --gamma.",
    )
    simulate.add_argument("torques", type=Path, metavar="TORQUES.csv")
    _output(simulate, "MOTION.csv")
    simulate.add_argument(
        "--gamma", type=_triple, metavar="G1,G2,G3", help="motor angles at the start, rad"
    )
    simulate.add_argument(
        "--gamma-dot", type=_triple, metavar="W1,W2,W3", help="motor rates at the start, rad/s"
    )

    export = command(
        "export-c",
        _export_c,
        "Write the dynamics of the robot as C for its controller: header, source, the robot's "
        "numbers and an example.",
    )
    export.add_argument("folder", type=Path, metavar="DIR")
    export.add_argument("--force", action="store_true", help="replace files that are there")

    command("info", _info, "Versions, the model, its mobility.")
    return parser


def _output(parser: argparse.ArgumentParser, metavar: str) -> None:
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar=metavar, help="ends in .csv or .npz"
    )
    parser.add_argument("--force", action="store_true", help="replace a file that is there")


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 10:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 10")
    return int(text)


def _triple(text: str) -> Array:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers like 0.1,0.2,0.3")
    return numbers


def _robot(arguments: argparse.Namespace) -> SST:
    return SST() if arguments.urdf is None else SST.from_urdf(arguments.urdf)


@contextmanager
def _progress(what: str, start: float, end: float) -> Iterator[Callable[[float], None]]:
    """A bar over simulated time, shown when it takes more than two seconds."""
    with tqdm(
        total=round(end - start, 9),
        desc=what,
        unit="s",
        delay=2,
        leave=False,
        bar_format="{desc} {percentage:3.0f}% |{bar}| {n:.3g}/{total:.3g} s of motion",
    ) as bar:

        def reach(t: float) -> None:
            bar.update(max(t - start - bar.n, 0))

        yield reach


# --- commands -------------------------------------------------------------------------------


def _paper(arguments: argparse.Namespace) -> None:
    from . import plots  # needs the extra `plot`

    robot, out = _robot(arguments), arguments.out
    t = np.linspace(0, PERIOD, arguments.samples)
    clock = time.perf_counter
    began = clock()
    example = example_1(robot, t)
    seconds = [clock() - began]
    starts = {"exact": False, "printed": True}
    motions = {}
    for name, rounded in starts.items():
        began = clock()
        with _progress(f"example 2, {name} start", t[0], t[-1]) as progress:
            motions[name] = example_2(robot, example, rounded, progress)
        seconds.append(clock() - began)

    files: dict[Path, Writer] = {}
    named = {"example_1": example} | {f"example_2_{name}_start": m for name, m in motions.items()}
    for stem, motion in named.items():
        for ending in (".csv", ".npz"):
            files[out / f"{stem}{ending}"] = motion.writer(f"{stem}{ending}")
    figures = plots.paper_figures(robot, example, motions["exact"], motions["printed"])
    files |= {out / name: writer for name, writer in figures.items()}
    write_files(files, arguments.force)

    print(f"Example 1: inverse dynamics along the circle, {len(t)} samples, {seconds[0]:.3f} s")
    print("                    tau_1      tau_2      tau_3")
    for label, values in (
        ("peak |tau| (N m)", np.abs(example.tau).max(axis=0)),
        ("RMS tau    (N m)", np.sqrt((example.tau**2).mean(axis=0))),
    ):
        print(f"{label}", *(f"{value:10.4f}" for value in values))
    print("Example 2: direct dynamics from those torques, one period")
    print("start     path error   closures   energy error   time")
    for (name, motion), elapsed in zip(motions.items(), seconds[1:], strict=True):
        returned = compare(robot, example, motion)
        print(
            f"{name:8}  {returned.path_error:.1e} rad  {returned.closure:.1e}    "
            f"{returned.energy:.1e} J     {elapsed:.2f} s{_remark(motion)}"
        )
    print(f"{len(files)} files in {out}")


def _torques(arguments: argparse.Namespace) -> None:
    motion = read_motion(_robot(arguments), arguments.motion)
    _save(motion, arguments)
    peaks = ", ".join(f"{value:.4g}" for value in np.abs(motion.tau).max(axis=0))
    print(f"{len(motion)} samples, peak torques {peaks} N m -> {arguments.output}")


def _simulate(arguments: argparse.Namespace) -> None:
    robot = _robot(arguments)
    table = read_table(arguments.torques)
    tau = table.select(["tau_1_Nm", "tau_2_Nm", "tau_3_Nm"])
    t = table.column("t_s")

    def start(name: str, option: Array | None, columns: list[str], flag: str) -> Array:
        if option is not None:
            return option
        if not set(columns) <= set(table.columns):
            raise FileFormatError(
                table.path, f"no columns {', '.join(columns)} to start from; give {flag}"
            )
        return table.select(columns)[0]

    names = [f"gamma_{k}_rad" for k in (1, 2, 3)]
    gamma = start("gamma", arguments.gamma, names, "--gamma G1,G2,G3")
    rates = start("rates", arguments.gamma_dot, [f"{n}_s" for n in names], "--gamma-dot W1,W2,W3")
    q0 = robot.forward_kinematics(gamma, near=_near(robot, table, arguments))
    unknown = np.zeros((len(t), 3))
    given = Trajectory(t, np.zeros((len(t), 9)), unknown, unknown, tau, robot.joint_names, MOTORS)
    with _progress("simulating", t[0], t[-1]) as progress:
        motion = robot.simulate(given, q0, rates, t, progress=progress)
    _save(motion, arguments)
    print(f"{len(motion)} samples to t = {motion.t[-1]:g} s -> {arguments.output}{_remark(motion)}")


def _near(robot: SST, table: Table, arguments: argparse.Namespace) -> Array:
    """Which assembly: that of the file's first row where it has one, else that next to home."""
    names = [f"{name}_rad" for name in robot.joint_names]
    if arguments.gamma is None and set(names) <= set(table.columns):
        return table.select(names)[0]
    return robot.home


def _save(motion: Trajectory, arguments: argparse.Namespace) -> None:
    motion.save(arguments.output, arguments.force)


def _remark(motion: Trajectory) -> str:
    return f"\n  {motion.stopped}" if motion.stopped else ""


def _export_c(arguments: argparse.Namespace) -> None:
    written = c_files(_robot(arguments), arguments.folder)
    write_files(written, arguments.force)
    print(f"{', '.join(path.name for path in written)} in {arguments.folder}")


def _info(arguments: argparse.Namespace) -> None:
    robot = _robot(arguments)
    packages = ("sst-pin", "pin", "numpy", "scipy", "matplotlib")
    print(f"Python {platform.python_version()} on {platform.system()} {platform.machine()}")
    print(", ".join(f"{name} {_version(name)}" for name in packages))
    print(f"model {robot.model.name}: {arguments.urdf or 'the shipped URDF'}")
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    print(f"  joints in the order of q: {', '.join(robot.joint_names)}")
    print(f"  moving mass {mass:.6g} kg, gravity {robot.model.gravity.linear.tolist()} m/s^2")
    friction = "none" if robot.friction.none else "viscous and Coulomb, as in the URDF"
    print(f"  friction {friction}")
    print(f"  dynamics by {robot.path}")
    print(robot.mobility(robot.home))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "(not installed)"
