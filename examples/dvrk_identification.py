# SPDX-License-Identifier: BSD-2-Clause
"""Two real arms of the da Vinci Research Kit, identified from public measurements.

The measurements are those of Y. Wang, R. Gondokaryono, A. Munawar, G. S. Fischer, A convex
optimization-based dynamic model identification package for the da Vinci Research Kit, IEEE RA-L
4(4), 2019; give the folder of your own copy of github.com/WPI-AIM/dvrk_dynamics_identification.
The descriptions here are open trees with modified Denavit-Hartenberg parameters of the arms and
their parallelograms as closures; masses are guesses, which the measurements replace.

pip install 'sst-pin[identification]'
python examples/dvrk_identification.py --data FOLDER
"""

import argparse
import time
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, decimate, sosfiltfilt

from sst_pin import ClosedChain, Closure, Coupling, LineForce, Trajectory, coordinate_motion
from sst_pin.identification import (
    BaseParameters,
    base_parameters,
    consistent_parameters,
    estimate,
    measured_motion,
    predicted_torques,
)

Array = NDArray[np.float64]

QUARTER = np.pi / 2
#: Angles per count of the motors: wrist of the MTM, and of the PSM's instrument.
PLATFORM, WRIST, JAW, JAW_OF_WRIST = 0.6697, 1.0186, 1.2178, -0.8306
MASSES = 105, 205  # grams


class Judge(NamedTuple):
    """How an arm is identified and judged.

    Attributes:
        cutoff: Frequency up to which logs are kept, [Hz].
        every: One sample of this many is used.
        frequency: Frequency at which the authors' filter ends, [Hz].
        period: Period of the motion; the authors judge the first one, [s].
        published: The authors' relative torque errors, of the first motors.
    """

    cutoff: float
    every: int
    frequency: float
    period: float
    published: tuple[float, ...]


#: The authors give 1.8 Hz and 5.4 Hz as angular frequencies, so that they filter pi times higher.
OF_MTM = Judge(10, 4, 1.8 * np.pi, 10.0, (0.077, 0.149, 0.170, 0.223, 0.280, 0.234, 0.340))
OF_PSM = Judge(10, 3, 5.4 * np.pi, 1 / 0.18, (0.093, 0.178, 0.191))
OF_WEIGHTS = 5.0, 2  # cut-off and every


class Arm(NamedTuple):
    """An arm and the parameters that its motors may show.

    Attributes:
        chain: The robot, its coordinates those of the logs.
        which: Names and patterns of the parameters.
    """

    chain: ClosedChain
    which: list[str]


class Row(NamedTuple):
    """A joint after Denavit and Hartenberg, modified: where it stands, and a guess of its body."""

    parent: str
    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    mass: float = 0.0
    slides: bool = False


def mtm() -> Arm:
    """The master tool manipulator: a parallelogram, a geared wrist platform, a spring."""
    upper = 0.2794
    lever = 0.1
    forearm = 0.3645
    rows = {
        "outer_yaw": Row("universe", d=-0.2154, mass=3),
        "shoulder": Row("outer_yaw", alpha=-QUARTER, theta=QUARTER, mass=2),
        "elbow": Row("shoulder", a=upper, theta=QUARTER, mass=1),
        "lever": Row("outer_yaw", alpha=-QUARTER, theta=np.pi, mass=2),
        "rod": Row("lever", a=lever, theta=-QUARTER, mass=0.3),
        "platform": Row("elbow", a=forearm, alpha=-QUARTER, d=0.151, mass=0.5),
        "wrist_pitch": Row("platform", alpha=QUARTER, mass=0.2),
        "wrist_yaw": Row("wrist_pitch", alpha=-QUARTER, theta=QUARTER, mass=0.15),
        "wrist_roll": Row("wrist_yaw", alpha=-QUARTER, theta=np.pi, mass=0.05),
        "motor_4": Row("universe"),
    }
    model = tree("mtm", rows, rotors=["motor_4"])
    frame(model, "rod_end", "rod", (upper, 0, 0))
    frame(model, "elbow_pin", "elbow", (lever, 0, 0))
    # the spring that balances the wrist pitch: its length follows from the law of cosines
    crank = 0.0075
    post = 0.1035
    angle = np.pi + np.deg2rad(23)
    at = model.jointPlacements[model.getJointId("wrist_pitch")]
    foot = at.act(post * np.array([np.cos(angle), np.sin(angle), 0]))
    frame(model, "spring_foot", "platform", foot)
    frame(model, "spring_crank", "wrist_pitch", (crank, 0, 0))
    spring = LineForce(
        "spring_foot", "spring_crank", stiffness=250, rest_length=0.0613, name="spring"
    )
    geared = {"shoulder": (0, PLATFORM), "lever": (0, -PLATFORM), "motor_4": (0, 1)}
    chain = ClosedChain(
        model,
        [Closure("rod_end", "elbow_pin", "3d"), Coupling("platform", geared)],
        ["outer_yaw", "shoulder", "lever", "motor_4", "wrist_pitch", "wrist_yaw", "wrist_roll"],
        lines=[spring],
    )
    return Arm(chain, [*shown(rows, list(rows)), "motor_4.armature", "spring.stiffness"])


def psm() -> Arm:
    """The patient side manipulator: bars that stay level, a counterweight, a geared instrument."""
    across = 0.04009
    bar = 0.516
    middle = 0.096
    up = 0.14454
    between = 0.03808
    to_centre = 0.4318
    tool = 0.4162
    wrist = 0.0091
    rows = {
        "yaw": Row("universe", alpha=QUARTER, theta=QUARTER, mass=3),
        "pitch": Row("yaw", alpha=-QUARTER, theta=-QUARTER, mass=2),
        "bottom": Row("pitch", mass=1),  # placed below
        "top": Row("pitch", mass=0.5),
        "end": Row("bottom", a=bar, mass=0.8),
        "front": Row("bottom", a=middle, theta=np.pi, mass=0.3),
        "insertion": Row("end", across, -QUARTER, up - to_centre, mass=0.5, slides=True),
        "counterweight": Row("pitch", across, -QUARTER, mass=0.5, slides=True),
        "roll": Row("insertion", d=tool),
        "wrist": Row("roll", alpha=QUARTER, theta=QUARTER),
        "jaw_1": Row("wrist", wrist, -QUARTER, theta=QUARTER),
        "jaw_2": Row("wrist", wrist, -QUARTER, theta=QUARTER),
        **{f"motor_{k}": Row("universe") for k in (5, 6, 7)},
        "jaws": Row("universe"),  # friction between them
    }
    rotors = ["roll", "motor_5", "motor_6", "motor_7"]
    model = tree("psm", rows, rotors)
    for name, height in (("bottom", up), ("top", up + between)):
        level = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi), np.array([across, height, 0.0]))
        model.jointPlacements[model.getJointId(name)] = level
    # the front link turns about a pin on the yaw link, parallel to the back link
    frame(model, "base_pin", "yaw", (0, 0, -middle))
    frame(model, "front_pin", "front", (-across, -up, 0))
    frame(model, "top_end", "top", (bar, 0, 0))
    frame(model, "end_pin", "end", (0, -between, 0))
    closures = [
        Closure("base_pin", "front_pin", "3d"),
        Closure("top_end", "end_pin", "3d"),
        Coupling("counterweight", {"insertion": (0, 1)}),
        Coupling("wrist", {"motor_5": (0, WRIST)}),
        Coupling("jaw_1", {"motor_5": (0, JAW_OF_WRIST), "motor_6": (0, JAW)}),
        Coupling("jaw_2", {"motor_5": (0, JAW_OF_WRIST), "motor_7": (0, JAW)}),
        Coupling("jaws", {"jaw_2": (0, 1), "jaw_1": (0, -1)}),
    ]
    home = pin.neutral(model)
    home[[6, 7]] = 0.15  # the insertion and its counterweight
    model.referenceConfigurations["home"] = home
    motors = ["yaw", "pitch", "insertion", "roll", "motor_5", "motor_6", "motor_7"]
    rubbing = ["yaw", "pitch", "insertion", "roll", "wrist", "jaw_1", "jaw_2"]
    which = shown(rows, [*rubbing, "motor_6", "motor_7", "jaws"])
    which += [*(f"{name}.armature" for name in rotors), "roll.stiffness"]
    return Arm(ClosedChain(model, closures, motors), which)


def tree(name: str, rows: dict[str, Row], rotors: list[str]) -> pin.Model:
    """The open tree of such joints."""
    model = pin.Model()
    model.name = name
    for joint, row in rows.items():
        turn = pin.SE3(pin.rpy.rpyToMatrix(row.alpha, 0.0, 0.0), np.zeros(3))
        at = turn * pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, row.theta), np.array([row.a, 0.0, row.d]))
        kind = pin.JointModelPZ() if row.slides else pin.JointModelRZ()
        k = model.addJoint(model.getJointId(row.parent), kind, at, joint)
        if row.mass:
            model.appendBodyToJoint(k, pin.Inertia.FromSphere(row.mass, 0.1), pin.SE3.Identity())
    armature = model.armature
    armature[[model.joints[model.getJointId(joint)].idx_v for joint in rotors]] = 1e-4
    model.armature = armature
    return model


def frame(model: pin.Model, name: str, joint: str, at: tuple[float, ...] | Array) -> None:
    """Add a frame on the body of a joint."""
    placement = pin.SE3(np.eye(3), np.array(at, dtype=float))
    model.addFrame(pin.Frame(name, model.getJointId(joint), placement, pin.FrameType.OP_FRAME))


def shown(rows: dict[str, Row], rubbing: list[str]) -> list[str]:
    """Parameters of all bodies, and friction with a constant part of some joints."""
    bodies = [f"{name}.{of}" for name, row in rows.items() if row.mass for of in ("m*", "i*")]
    return bodies + friction(rubbing)


def friction(joints: Iterable[str]) -> list[str]:
    """Names of the friction of joints, which may be unlike in both directions."""
    return [f"{name}.{of}" for name in joints for of in ("viscous", "coulomb", "offset")]


def motion_of(chain: ClosedChain, log: Array, cutoff: float, speed: float = 1.0) -> Trajectory:
    """A log of positions, rates and torques of seven motors, 200 samples in a second."""
    t = np.arange(len(log)) / (200 * speed)
    return measured_motion(chain, t, log[:, :7], log[:, 14:], cutoff=cutoff * speed)


def without_cable(log: Array, cable: Array) -> Array:
    """Without the torque of the electrical cable at the MTM's platform, a polynomial."""
    into = np.array([0, PLATFORM, -PLATFORM, 1, 0, 0, 0])
    log = log.copy()
    log[:, 14:] -= np.outer(np.polyval(cable, log[:, :7] @ into), into)
    return log


def as_the_authors(chain: ClosedChain, log: Array, judge: Judge) -> Trajectory:
    """The first period as its authors filter it: rates, torques and the others, each by itself."""
    sections = butter(6, judge.frequency, fs=200, output="sos")
    end = 200 + int(200 * judge.period)
    rates = log[:, 7:14]
    logged = log[:, :7], rates, np.gradient(rates, 1 / 200, axis=0), log[:, 14:]
    x, va, aa, tau = (sosfiltfilt(sections, each, axis=0)[200:end:4] for each in logged)
    t = np.arange(len(x)) / 50
    return chain.trajectory(t, coordinate_motion(chain, t, x).q, va, aa, tau)


def relative_errors(
    chain: ClosedChain, theta: ArrayLike, motion: Trajectory, every: int, period: float
) -> Array:
    """Relative errors of the torques in the first period, both sides decimated, (motors,)."""
    first = int(np.searchsorted(motion.t, motion.t[0] + period))
    off = predicted_torques(chain, theta, motion) - motion.tau
    size = motion.tau
    if every > 1:
        off, size = (decimate(each, every, axis=0) for each in (off, size))
    off, size = (np.linalg.norm(each[: first // every], axis=0) for each in (off, size))
    return np.asarray(off / size)


def judged(arm: Arm, training: Array, test: Array, judge: Judge) -> None:
    """Identify an arm and print how well physically consistent parameters predict."""
    chain, base = arm.chain, base_parameters(arm.chain, arm.which)
    seen, unseen = (motion_of(chain, log, judge.cutoff) for log in (training, test))
    logged = seen.q, seen.va, seen.aa, seen.tau
    found = estimate(chain, base, *logged, decimate=judge.every, robust=True)
    theta = consistent_parameters(chain, found)
    theirs = as_the_authors(chain, test, judge)
    alike = relative_errors(chain, theta, theirs, 1, judge.period)
    both = relative_errors(chain, theta, unseen, judge.every, judge.period)
    print(f"\n{chain.model.name}: {len(base)} base parameters of {len(base.considered)}")
    print("relative torque error  published  their filter  both sides filtered")
    for k, name in enumerate(chain.motor_names):
        told = f"{judge.published[k]:.3f}" if k < len(judge.published) else ""
        print(f"  {name:20s}  {told:>7s}  {alike[k]:11.3f}  {both[k]:12.3f}")


class Weights(NamedTuple):
    """The first moments that two weights add about the pitch axis, [kg m].

    Attributes:
        moments: Across the link and along it, for 105 g and 205 g, shape (2, 2).
        deviations: Their standard deviations, shape (2, 2).
        runs: Standard deviations between runs without weight, shape (2,).
    """

    moments: Array
    deviations: Array
    runs: Array

    def ratio(self, k: int) -> tuple[float, float] | None:
        """The 95 % interval of the ratio of two moments (E. C. Fieller), or None if it has no end.

        Both weights were compared to the same run without weight, so that errors are correlated.
        """
        (a, b), (of_a, of_b) = self.moments[:, k], self.deviations[:, k] ** 2
        common = self.runs[k] ** 2 / 2
        p = a * a - 3.84 * of_a
        q = a * b - 3.84 * common
        r = b * b - 3.84 * of_b
        if p <= 0:  # the smaller weight is not seen
            return None
        half = np.sqrt(q * q - p * r)
        return float((q - half) / p), float((q + half) / p)


def added(
    chain: ClosedChain, base: BaseParameters, theta: Array, motion: Trajectory, every: int
) -> tuple[Array, Array]:
    """First moments beside those of theta, and their standard deviations, each of shape (2,)."""
    guess = np.asarray(chain.dynamic_parameters)
    tau = motion.tau + predicted_torques(chain, guess - theta, motion)
    found = estimate(chain, base, motion.q, motion.va, motion.aa, tau, decimate=every)
    rows = [base.names.index(name) for name in ("pitch.mx", "pitch.my")]
    return (found.values - base.matrix @ guess)[rows], found.deviations[rows]


def weighed(arm: Arm, data: Path) -> None:
    """Print the first moments that the weights add, and their ratios."""
    chain = arm.chain
    logs = data / "psm_simplified" / "measured_trajectory"
    cutoff, every = OF_WEIGHTS
    empty = motion_of(chain, read(logs / "one_no_weight_results.csv"), cutoff)
    base = base_parameters(chain, arm.which)
    without = estimate(chain, base, empty.q, empty.va, empty.aa, empty.tau, decimate=every)
    theta = np.asarray(consistent_parameters(chain, without))
    # friction and constant torques are found anew, because they change from run to run
    which = ["yaw.my", "yaw.izz", "pitch.m*", "pitch.i*"]
    base = base_parameters(chain, [*which, *friction(chain.motor_names[:3])])
    again = read(data / "psm" / "measured_trajectory" / "one_results.csv")
    runs = np.abs(added(chain, base, theta, motion_of(chain, again, cutoff), every)[0])
    print("\nfirst moments about the pitch axis that the weights add, [g m], 95 % intervals")
    print("              a second run without weight:")
    print(f"                {1e3 * runs[0]:.1f} across the link, {1e3 * runs[1]:.1f} along it")
    print("                        105 g            205 g           ratio (205/105 = 1.95)")
    for speed, place in product((1.0, 0.5), ("insertion", "parallel")):
        found = []
        for mass in MASSES:
            log = read(logs / f"one_results_{speed}_scale_{mass}_grams_{place}.csv")
            motion = motion_of(chain, log, cutoff, speed)
            found.append(added(chain, base, theta, motion, every))
        moments, formal = np.array(found).swapaxes(0, 1)
        weights = Weights(moments, np.hypot(formal, runs), runs)
        for k, way in enumerate(("across", "along")):
            pairs = zip(weights.moments[:, k], weights.deviations[:, k], strict=True)
            told = "  ".join(f"{1e3 * m:6.1f} +- {1e3 * 1.96 * s:4.1f}" for m, s in pairs)
            ends = weights.ratio(k)
            ratio = f"{ends[0]:.2f} to {ends[1]:.2f}" if ends else "105 g cannot be seen"
            print(f"{place:9s} x {speed}  {way:6s}  {told}   {ratio}")


def read(path: Path) -> Array:
    """A log without header."""
    return np.loadtxt(path, delimiter=",")


def main(folder: Path) -> None:
    """Identify both arms and weigh the weights."""
    begin = time.perf_counter()
    data = folder / "data" if (folder / "data").is_dir() else folder
    there_and_back = read(data / "mtm" / "joint_test" / "one_results.csv")
    cable = np.polyfit(there_and_back[:, 0], there_and_back[:, 2], 7)
    for arm, judge in ((mtm(), OF_MTM), (psm(), OF_PSM)):
        name = arm.chain.model.name
        logs = data / name / "measured_trajectory"
        training, test = (read(logs / f"{run}_results.csv") for run in ("one", "two"))
        if name == "mtm":
            training = without_cable(training, cable)
            test = without_cable(test, cable)
        judged(arm, training, test, judge)
    weighed(arm, data)
    print(f"\n{time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER")
    main(parser.parse_args().data)
