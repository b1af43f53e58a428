# SPDX-License-Identifier: BSD-2-Clause
"""Controllers on machines that their model does not know well: the SST and a delta in MuJoCo.

The machines have closed loops, friction in every joint and limits of torque. Their motors have
encoders with steps; every millisecond a controller gets the pose from them and sets torques. The
masses of the controllers' models are 20 % too small, and they have no friction. The star follows
ten circles of the paper, the delta's platform ten of a radius of 50 mm; both are pushed in the
sixth.

    python examples/control_bench.py [--picture control_bench.png]
"""

import argparse

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

import sst_pin
from adaptive import Adaptive

PERIOD = 1e-3
CIRCLE = np.pi / 6
CIRCLES = 10
#: Steps of an encoder in a turn; first-order filter of the rates, [s].
COUNTS, FILTER = 2**17, 2e-3
#: Limits of the motors, [N m]; friction of each joint of the machine, [N m s/rad] and [N m].
LIMIT, DAMPING, DRY = 40.0, 0.02, 0.05
#: A moment on the star, [N m], for a time, [s].
PUSH, PUSH_AT, PUSH_FOR = 15.0, 5.5 * CIRCLE, 0.03
#: Inertia at the motors and friction of the delta in parts of those of the SST.
SMALLER = 0.01


class Machine:
    """A closed robot in MuJoCo, the SST by default, one of whose bodies is pushed."""

    def __init__(self, xml=None, body="star_1", push=(0, 0, 0, PUSH, PUSH, PUSH), friction=1.0):
        import mujoco

        self._mujoco = mujoco
        if xml is None:
            self.model = mujoco.MjModel.from_xml_path(str(sst_pin.sst.MJCF_PATH))
        else:
            self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.dof_damping[:] = DAMPING * friction
        self.model.dof_frictionloss[:] = DRY * friction
        self.data = mujoco.MjData(self.model)
        self._steps = round(PERIOD / self.model.opt.timestep)
        self._body = self.model.body(body).id
        self._push = np.array(push)

    def start(self, q, v):
        """Put the machine into a state; quaternions of MuJoCo begin with w."""
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q, v
        for joint in np.flatnonzero(self.model.jnt_type == self._mujoco.mjtJoint.mjJNT_BALL):
            k = self.model.jnt_qposadr[joint]
            self.data.qpos[k : k + 4] = np.roll(q[k : k + 4], 1)

    def step(self, tau, push=1.0):
        """Hold torques for a period of the controller; push the body when it is time."""
        pushed = PUSH_AT <= self.data.time < PUSH_AT + PUSH_FOR
        self.data.xfrc_applied[self._body] = push * pushed * self._push
        self.data.ctrl[:] = tau
        self._mujoco.mj_step(self.model, self.data, self._steps)
        return self.data.qpos.copy()


def xml_of(chain):
    """A chain of hinges, universal joints and balls with point closures as MJCF, without shapes."""
    model = chain.model
    axes = {"JointModelRY": ["0 1 0"], "JointModelUniversal": ["1 0 0", "0 1 0"]}

    def numbers(*x):
        return " ".join(map(repr, np.ravel(x).tolist()))

    def body(k):
        name = model.names[k]
        at = model.jointPlacements[k]
        inertia = model.inertias[k]
        kind = model.joints[k].shortname()
        parts = [
            f'<joint name="{name}{i or ""}" axis="{axis}"/>'
            for i, axis in enumerate(axes.get(kind, []))
        ] or [f'<joint name="{name}" type="ball"/>']
        moments = inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        parts += [
            f'<inertial pos="{numbers(inertia.lever)}" mass="{inertia.mass!r}"'
            f' fullinertia="{numbers(moments)}"/>'
        ]
        parts += [
            f'<site name="{frame.name}" pos="{numbers(frame.placement.translation)}"/>'
            for frame in model.frames
            if frame.parentJoint == k and frame.type == pin.FrameType.OP_FRAME
        ]
        parts += [body(i) for i in range(1, model.njoints) if model.parents[i] == k]
        quat = np.roll(pin.Quaternion(at.rotation).coeffs(), 1)
        place = f'pos="{numbers(at.translation)}" quat="{numbers(quat)}"'
        return f'<body name="{name}" {place}>{"".join(parts)}</body>'

    stiff = 'solref="0.001 1" solimp="0.9999 0.9999 0.001"'
    pairs = [f'site1="{c.frame_a}" site2="{c.frame_b}"' for c in chain.closures]
    bodies = [body(i) for i in range(1, model.njoints) if model.parents[i] == 0]
    return f"""<mujoco>
      <compiler angle="radian"/>
      <option timestep="0.0005" integrator="RK4"/>
      <worldbody>{"".join(bodies)}</worldbody>
      <equality>{"".join(f"<connect {pair} {stiff}/>" for pair in pairs)}</equality>
      <actuator>{"".join(f'<motor joint="{name}"/>' for name in chain.motor_names)}</actuator>
    </mujoco>"""


def poor_model(robot=None):
    """A robot, the SST by default, as the controllers know it."""
    robot = robot or sst_pin.SST()
    for body in range(1, robot.model.njoints):
        inertia = robot.model.inertias[body]
        inertia.mass, inertia.inertia = 0.8 * inertia.mass, 0.8 * inertia.inertia
    robot.refresh()
    robot.compile()
    return robot


def circles(robot):
    """The motion to follow."""
    t = np.linspace(0, CIRCLES * CIRCLE, round(CIRCLES * CIRCLE / 2e-3) + 1)
    R, omega, alpha = sst_pin.paper_circle(t)
    return robot.trajectory(t, *robot.joint_motion(R, omega, alpha))


def circles_of_the_delta(robot):
    """Its platform on a circle of 50 mm, ten times."""
    t = np.linspace(0, CIRCLES * CIRCLE, round(CIRCLES * CIRCLE / 2e-3) + 1)
    poses = np.tile(robot.platform_pose(robot.home), (len(t), 1, 1))
    angle = 2 * np.pi * t / CIRCLE
    poses[:, :2, 3] = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    q = robot.inverse_kinematics(poses)
    return sst_pin.coordinate_motion(robot, t, q[:, motors_of(robot)])


def motors_of(robot):
    """Where the positions of the motors are in q, and in the state of the machine."""
    return [robot.position_names.index(name) for name in robot.motor_names]


def controllers(robot, motion, limit=LIMIT, inertia=1.0, learning=0.1):
    """Each with gains of a bandwidth of some 20 Hz, and the same limits.

    `inertia` is that at the motors in parts of the SST's.
    """
    both = {"limits": limit}
    weights = {"Q": [3e5] * 3 + [30] * 3, "R": [0.3 / inertia**2] * 3}
    return {
        "PD + gravity": sst_pin.GravityPD(robot, motion, kp=600 * inertia, kd=12 * inertia, **both),
        "LQR": sst_pin.TrackingLQR(robot, motion, **weights, **both),
        "adaptive": Adaptive(
            robot, motion, stiffness=60, damping=12 * inertia, learning=learning, limit=limit
        ),
        "computed torque": sst_pin.ComputedTorque(robot, motion, kp=1.5e4, kd=240, **both),
    }


def run(motion, controller, machine):
    """Errors of the motors in the middle of each period, (N, 3), [rad], and torques, (N, 3)."""
    robot = controller.chain
    q = motion.q[0]
    va = motion.va[0]
    motors = motors_of(robot)
    step = 2 * np.pi / COUNTS
    keep = np.exp(-PERIOD / FILTER)
    machine.start(q, robot.joint_rates(q, va))
    times = PERIOD * np.arange(round(motion.t[-1] / PERIOD))
    measured = q[motors]
    found = []
    torques = []
    for t in times:
        torques.append(controller.torque(t, q, va))
        before = measured
        measured = step * np.round(machine.step(torques[-1])[motors] / step)
        found.append(machine.data.qpos[motors])
        va = keep * va + (1 - keep) * (measured - before) / PERIOD
        guess = q.copy()
        guess[motors] = measured
        q = robot.assemble(guess)
    wanted = make_interp_spline(motion.t, motion.q[:, motors], 5)(times + PERIOD)
    return wanted - found, np.array(torques)


def row(errors, torques):
    """RMS error before the push, peak after it, peak torque, and time to recover.

    It has recovered when the error stays below twice its largest value before the push.
    """
    size = np.abs(errors).max(axis=1)
    times = PERIOD * np.arange(1, len(errors) + 1)
    calm = (times > 2 * CIRCLE) & (times < PUSH_AT)
    after = times >= PUSH_AT
    late = times[after][size[after] > 2 * size[calm].max()]
    recovered = late.max() - PUSH_AT if late.size else 0.0
    rms = np.sqrt((errors[calm] ** 2).mean())
    return rms, size[after].max(), np.abs(torques).max(), recovered


def bench(name):
    """The motion of a robot, "SST" or "delta", its controllers by name, and its machine."""
    if name == "SST":
        robot = poor_model()
        motion = circles(robot)
        return motion, controllers(robot, motion), Machine()
    robot = poor_model(sst_pin.robots.delta())
    exact = sst_pin.robots.delta()
    motion = circles_of_the_delta(robot)
    machine = Machine(xml_of(exact), "ball", (3, 3, 3, 0, 0, 0), SMALLER)
    return motion, controllers(robot, motion, 2.0, SMALLER, 0.03), machine


def table(name, only=()):
    """For each controller, or some, what `row` gives, in mrad, mrad, N m and ms."""
    motion, each, machine = bench(name)
    return {
        called: np.multiply(row(*run(motion, controller, machine)), (1e3, 1e3, 1.0, 1e3))
        for called, controller in each.items()
        if not only or called in only
    }


def picture(path):
    """Errors of all controllers on both machines."""
    from matplotlib.figure import Figure

    from sst_pin import plots

    with plots.style():
        figure = Figure(figsize=(7.2, 3.6), layout="constrained")
        for axes, name in zip(figure.subplots(1, 2, sharey=True), ("SST", "delta"), strict=True):
            motion, each, machine = bench(name)
            for called, controller in each.items():
                errors, _ = run(motion, controller, machine)
                t = PERIOD * np.arange(1, len(errors) + 1)
                axes.semilogy(t, 1e3 * np.abs(errors).max(axis=1).clip(1e-5), label=called)
            axes.axvspan(PUSH_AT, PUSH_AT + PUSH_FOR, color="0.8")
            axes.set(title=name, xlabel="time (s)", ylim=(1e-2, 1e2))
        figure.axes[0].set_ylabel("largest error of a motor (mrad)")
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4)
        figure.savefig(path, dpi=200)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Controllers on machines that they know poorly.")
    parser.add_argument("--picture", help="file for a picture of the errors")
    arguments = parser.parse_args()
    for name in ("SST", "delta"):
        print(
            f"{name + ': controller':24}{'RMS error':>12}{'peak error':>12}{'peak torque':>13}"
            f"{'recovers in':>13}"
        )
        for called, (rms, peak, torque, recovered) in table(name).items():
            print(
                f"{called:24}{rms:7.2f} mrad{peak:7.1f} mrad{torque:9.2f} N m{recovered:10.0f} ms"
            )
    if arguments.picture:
        picture(arguments.picture)
