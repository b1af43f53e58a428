# SPDX-License-Identifier: BSD-2-Clause
"""ROS 2: the positions of the motors in, the states of all joints out, at a rate.

Drives report the motors. `robot_state_publisher` and RViz need every joint of the URDF: the passive
joints of closed loops follow from the motors.

    python examples/joint_state_relay.py urdf/sst.urdf --rate 100

listens to `motor_states` and publishes `joint_states`, both `sensor_msgs/JointState`; remap them as
usual. `Relay` itself needs no ROS.
"""

import argparse
import math
import sys
from collections.abc import Mapping

import numpy as np

import sst_pin

#: Longest way of a motor between two assemblies, [rad] or [m]: the loops stay in their mode.
STEP = 0.1


class Relay:
    """The states of all joints of a robot from those of its motors.

    It starts at home, or from a configuration given, and follows the motors in short steps, so that
    the assembly mode stays. Joints with more than one coordinate, which no `JointState` can have,
    are left out.
    """

    def __init__(self, chain: sst_pin.ClosedChain, start: np.ndarray | None = None) -> None:
        self.chain, self.q = chain, chain.home if start is None else chain.assemble(start)
        joints = [chain.model.joints[chain.model.getJointId(name)] for name in chain.joint_names]
        single = [(n, j) for n, j in zip(chain.joint_names, joints, strict=True) if j.nv == 1]
        self.names = [name for name, _ in single]
        self._joints = dict(single)

    def states(
        self, positions: Mapping[str, float], rates: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions and rates of the joints `names`.

        Args:
            positions: Position of each motor by its name, [rad] or [m]; others are passed over.
            rates: Rate of each coordinate, [rad/s] or [m/s]; zero where one is missing.

        Raises:
            sst_pin.InputError: If a motor is missing or a number is not finite.
            sst_pin.ClosureError: If the loops do not close there; the state is as before.
        """
        motors = self.chain.motor_names
        if missing := [name for name in motors if not math.isfinite(positions.get(name, math.nan))]:
            raise sst_pin.InputError("positions", f"no number for {', '.join(missing)}")
        before = self._positions(self.q)
        ways = {name: positions[name] - before[name] for name in motors}
        steps = max(1, math.ceil(max(map(abs, ways.values())) / STEP))
        q = self.q
        for k in range(1, steps + 1):
            guess = q.copy()
            for name, way in ways.items():
                self._put(guess, name, before[name] + way * k / steps)
            q = self.chain.assemble(guess, motors)
        self.q = q
        v = self.chain.joint_rates(q, [rates.get(name, 0.0) for name in self.chain.coordinates])
        now = self._positions(q)
        return (
            np.array([now[name] for name in self.names]),
            np.array([v[self._joints[name].idx_v] for name in self.names]),
        )

    def _positions(self, q: np.ndarray) -> dict[str, float]:
        found = {}
        for name, joint in self._joints.items():
            at = q[joint.idx_q : joint.idx_q + joint.nq]
            found[name] = float(at[0] if joint.nq == 1 else np.arctan2(at[1], at[0]))
        return found

    def _put(self, q: np.ndarray, name: str, position: float) -> None:
        joint = self._joints[name]
        endless = np.cos(position), np.sin(position)
        q[joint.idx_q : joint.idx_q + joint.nq] = position if joint.nq == 1 else endless


def main(arguments: list[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    parser = argparse.ArgumentParser(description="Relay the states of motors to all joints.")
    parser.add_argument("robot", help="URDF with its cuts and an SRDF with home beside it")
    parser.add_argument("--rate", type=float, default=100.0, help="of joint_states, [1/s]")
    options, others = parser.parse_known_args(arguments)
    try:
        import rclpy
        from sensor_msgs.msg import JointState
    except ImportError:
        sys.exit("rclpy and sensor_msgs are needed: source the setup file of ROS 2 first")
    relay = Relay(sst_pin.ClosedChain.from_urdf(options.robot))
    heard = []
    rclpy.init(args=others)
    node = rclpy.create_node("joint_state_relay")
    publisher = node.create_publisher(JointState, "joint_states", 10)

    def hear(message: JointState) -> None:
        heard[:] = [message]

    def publish() -> None:
        if not heard:
            return
        (motors,) = heard
        try:
            positions, rates = relay.states(
                dict(zip(motors.name, motors.position, strict=False)),
                dict(zip(motors.name, motors.velocity, strict=False)),  # which may be left out
            )
        except sst_pin.SSTError as error:
            node.get_logger().error(str(error), throttle_duration_sec=1.0)
            return
        message = JointState()
        message.header.stamp = (
            motors.header.stamp
        )  # of the measurement: old ones are seen to be old
        message.name = relay.names
        message.position, message.velocity = positions.tolist(), rates.tolist()
        publisher.publish(message)

    node.create_subscription(JointState, "motor_states", hear, 10)
    node.create_timer(1.0 / options.rate, publish)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
