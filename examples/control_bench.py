# SPDX-License-Identifier: BSD-2-Clause
"""Controllers on a machine that their model does not know well: the SST in MuJoCo.

The machine has closed loops, friction in every joint and limits of torque. Its motors have encoders
with steps; every millisecond a controller gets the pose from them and sets torques. The masses of
the controllers' model are 20 % too small, and it has no friction. The star follows ten circles of
the paper and is pushed in the sixth.

    python examples/control_bench.py
"""

import numpy as np
from scipy.interpolate import make_interp_spline

import sst_pin

PERIOD, CIRCLE, CIRCLES = 1e-3, np.pi / 6, 10
#: Steps of an encoder in a turn; first-order filter of the rates, [s].
COUNTS, FILTER = 2**17, 2e-3
#: Limits of the motors, [N m]; friction of each joint of the machine, [N m s/rad] and [N m].
LIMIT, DAMPING, DRY = 40.0, 0.02, 0.05
#: A moment on the star, [N m], for a time, [s].
PUSH, PUSH_AT, PUSH_FOR = 15.0, 5.5 * CIRCLE, 0.03


class Machine:
    """The closed SST in MuJoCo."""

    def __init__(self):
        import mujoco

        self._mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_path(str(sst_pin.MJCF_PATH))
        self.model.dof_damping[:] = DAMPING
        self.model.dof_frictionloss[:] = DRY
        self.data = mujoco.MjData(self.model)
        self._steps = round(PERIOD / self.model.opt.timestep)
        self._star = self.model.body("star_1").id

    def start(self, q, v):
        """Put the machine into a state."""
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q, v

    def step(self, tau, push=PUSH):
        """Hold torques for a period of the controller; push the star when it is time."""
        pushed = PUSH_AT <= self.data.time < PUSH_AT + PUSH_FOR
        self.data.xfrc_applied[self._star, 3:] = push * np.array([1.0, 1.0, 1.0]) * pushed
        self.data.ctrl[:] = tau
        self._mujoco.mj_step(self.model, self.data, self._steps)
        return self.data.qpos.copy()


def poor_model():
    """The SST as the controllers know it."""
    robot = sst_pin.SST()
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


def controllers(robot, motion):
    """Each with gains of a bandwidth of some 20 Hz, and the same limits."""
    return {
        "PD + gravity": sst_pin.GravityPD(robot, motion, kp=600, kd=12, limits=LIMIT),
        "LQR": sst_pin.TrackingLQR(
            robot, motion, Q=[3e5] * 3 + [30] * 3, R=[0.3] * 3, limits=LIMIT
        ),
        "adaptive": sst_pin.Adaptive(
            robot, motion, stiffness=60, damping=12, learning=0.1, limits=LIMIT
        ),
        "computed torque": sst_pin.ComputedTorque(robot, motion, kp=1.5e4, kd=240, limits=LIMIT),
    }


def run(motion, controller, machine):
    """Errors of the motors in the middle of each period, (N, 3), [rad], and torques, (N, 3)."""
    robot, q, va = controller.chain, motion.q[0], motion.va[0]
    motors, step, keep = list(robot.actuated), 2 * np.pi / COUNTS, np.exp(-PERIOD / FILTER)
    machine.start(q, robot.joint_rates(q, va))
    times = PERIOD * np.arange(round(motion.t[-1] / PERIOD))
    measured, found, torques = q[motors], [], []
    for t in times:
        torques.append(controller.torque(t, q, va))
        before, measured = measured, step * np.round(machine.step(torques[-1])[motors] / step)
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
    size, times = np.abs(errors).max(axis=1), PERIOD * np.arange(1, len(errors) + 1)
    calm = (times > 2 * CIRCLE) & (times < PUSH_AT)
    after = times >= PUSH_AT
    late = times[after][size[after] > 2 * size[calm].max()]
    recovered = late.max() - PUSH_AT if late.size else 0.0
    rms = np.sqrt((errors[calm] ** 2).mean())
    return rms, size[after].max(), np.abs(torques).max(), recovered


def table():
    """For each controller what `row` gives, in mrad, mrad, N m and ms."""
    robot, machine = poor_model(), Machine()
    motion, units = circles(robot), (1e3, 1e3, 1.0, 1e3)
    return {
        name: np.multiply(row(*run(motion, controller, machine)), units)
        for name, controller in controllers(robot, motion).items()
    }


if __name__ == "__main__":
    print(
        f"{'controller':18}{'RMS error':>12}{'peak error':>12}{'peak torque':>13}"
        f"{'recovers in':>13}"
    )
    for name, (rms, peak, torque, recovered) in table().items():
        print(f"{name:18}{rms:7.2f} mrad{peak:7.1f} mrad{torque:9.1f} N m{recovered:10.0f} ms")
