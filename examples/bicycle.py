# SPDX-License-Identifier: BSD-2-Clause
"""The benchmark bicycle: two wheels that roll without slip, and its eigenvalues over speed.

pip install 'sst-pin[plot]'
python examples/bicycle.py                # writes bicycle.png

J. P. Meijaard, J. M. Papadopoulos, A. Ruina and A. L. Schwab, Proc. R. Soc. A 463 (2007).
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

import sst_pin
from sst_pin import plots

WHEELBASE = 1.02  # [m]
TRAIL = 0.08  # [m]
TILT = np.pi / 10  # angle of the steer axis [rad]
REAR_RADIUS = 0.3  # [m]
FRONT_RADIUS = 0.35  # [m]
STABLE = (4.29238253634111, 6.02426201538837)  # weave and capsize speed of the paper [m/s]
COORDINATES = ["roll", "rear_wheel", "steer"]


def bicycle() -> sst_pin.ClosedChain:
    """The bicycle in the paper's axes: x forward, y to the right, z down.

    The base has z up, so the first joint stands on its head. All angles are zero when the
    bicycle stands upright and goes straight on.
    """
    model = pin.Model()
    model.name = "bicycle"
    upside_down = pin.SE3(rpyToMatrix(np.pi, 0.0, 0.0), np.zeros(3))
    joint = 0
    for name, kind in (
        ("x", pin.JointModelPX()),
        ("y", pin.JointModelPY()),
        ("z", pin.JointModelPZ()),
        ("yaw", pin.JointModelRZ()),
        ("roll", pin.JointModelRX()),
        ("pitch", pin.JointModelRY()),  # the rear frame, its origin in the rear hub
    ):
        joint = model.addJoint(joint, kind, pin.SE3.Identity() if joint else upside_down, name)
    rear = joint
    axis_point = np.array([WHEELBASE + TRAIL, 0, REAR_RADIUS])  # where it meets the ground
    axis = pin.SE3(rpyToMatrix(0.0, TILT, 0.0), axis_point)
    rear_wheel = model.addJoint(rear, pin.JointModelRY(), pin.SE3.Identity(), "rear_wheel")
    steer = model.addJoint(rear, pin.JointModelRZ(), axis, "steer")
    front_hub = np.array([WHEELBASE, 0, REAR_RADIUS - FRONT_RADIUS])
    hub = axis.actInv(pin.SE3(np.eye(3), front_hub))
    front_wheel = model.addJoint(steer, pin.JointModelRY(), hub, "front_wheel")

    # Mass, mass centre from the rear contact, and inertia about it, all along the paper's axes.
    from_contact = np.array([0, 0, REAR_RADIUS])
    frame_inertia = np.array([[9.2, 0, 2.4], [0, 11, 0], [2.4, 0, 2.8]])
    fork_inertia = np.array([[0.05892, 0, -0.00756], [0, 0.06, 0], [-0.00756, 0, 0.00708]])
    frame = pin.Inertia(85.0, np.array([0.3, 0, -0.9]) + from_contact, frame_inertia)
    fork = pin.Inertia(4.0, np.array([0.9, 0, -0.7]) + from_contact, fork_inertia)
    here = pin.SE3.Identity()
    model.appendBodyToJoint(rear, frame, here)
    model.appendBodyToJoint(steer, fork, axis.inverse())
    wheel = pin.Inertia(2.0, np.zeros(3), np.diag([0.0603, 0.12, 0.0603]))
    model.appendBodyToJoint(rear_wheel, wheel, here)
    wheel = pin.Inertia(3.0, np.zeros(3), np.diag([0.1405, 0.28, 0.1405]))
    model.appendBodyToJoint(front_wheel, wheel, here)

    axle = pin.SE3(rpyToMatrix(np.pi / 2, 0.0, 0.0), np.zeros(3))  # z of the disc along y
    closures = []
    for name, number, radius in (
        ("rear", rear_wheel, REAR_RADIUS),
        ("front", front_wheel, FRONT_RADIUS),
    ):
        model.addFrame(pin.Frame(f"{name}_hub", number, axle, pin.FrameType.OP_FRAME))
        closures.append(sst_pin.Rolling("universe", f"{name}_hub", radius))
    home = np.zeros(model.nq)
    home[2] = -REAR_RADIUS
    model.referenceConfigurations["home"] = home
    return sst_pin.ClosedChain(model, closures, COORDINATES)


def eigenvalues(chain: sst_pin.ClosedChain, speed: float) -> np.ndarray:
    """Four eigenvalues of roll and steer, straight on at a speed, shape (4,), [1/s].

    The linear system has two more, zero: the speed and the way are free.
    """
    A, _ = chain.linearize(chain.home, [0, -speed / REAR_RADIUS, 0], np.zeros(3))
    roll_and_steer = [0, 2, 3, 5]
    return np.linalg.eigvals(A[np.ix_(roll_and_steer, roll_and_steer)])


def main() -> None:
    """Draw the eigenvalues for speeds from 0 to 10 m/s."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    chain = bicycle()
    speeds = np.linspace(0, 10, 401)
    values = np.array([eigenvalues(chain, speed) for speed in speeds])
    with plots.style():
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        axes = figure.add_subplot(xlabel="speed (m/s)", ylabel="eigenvalue (1/s)", ylim=(-10, 12))
        axes.axvspan(*STABLE, color="0.9")
        axes.text(sum(STABLE) / 2, -9.4, "stable by itself", ha="center")
        axes.axhline(0, color="0.5", lw=0.8)
        oscillates = np.abs(values.imag) > 1e-9
        for name, part, colour, size in (
            ("real part of weave", np.where(oscillates, values.real, np.nan), "C0", 3),
            ("real eigenvalues", np.where(oscillates, np.nan, values.real), "C1", 3),
            ("imaginary part of weave", np.where(oscillates, values.imag, np.nan), "C2", 1.5),
        ):
            lines = axes.plot(speeds, part, ".", color=colour, markersize=size)
            lines[0].set_label(name)
        axes.text(7.6, 0.5, "capsize")
        axes.text(0.6, -8.6, "castering")
        axes.legend(loc="upper left", markerscale=3)
        figure.savefig(Path("bicycle.png"), dpi=150)


if __name__ == "__main__":
    main()
