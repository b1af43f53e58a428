# SPDX-License-Identifier: BSD-2-Clause
"""States of all joints from those of the motors, as the ROS 2 example relays them."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import sst_pin
from sst_pin import robots
from tests.support.files import load

joint_state_relay = load("examples/joint_state_relay.py")
Relay = joint_state_relay.Relay


def test_states_close_the_loops_and_rates_are_those_of_the_positions():
    chain = sst_pin.ClosedChain.from_urdf("examples/delta.urdf")
    relay, dt, seen = Relay(chain, np.full(19, 0.1)), 1e-4, []
    for t in (0.3 - dt, 0.3, 0.3 + dt):
        angles = 0.3 * np.sin(t * np.arange(1, 4))
        rates = 0.3 * np.cos(t * np.arange(1, 4)) * np.arange(1, 4)
        motors = chain.motor_names
        positions = dict(zip(motors, angles, strict=True))
        seen.append(relay.states(positions, dict(zip(motors, rates, strict=True))))
        assert np.abs(chain.residual(relay.q)).max() < 1e-9
        now = dict(zip(relay.names, seen[-1][0], strict=True))
        assert [now[name] for name in motors] == pytest.approx(angles)
    (before, _), (_, rates), (after, _) = seen
    assert rates == pytest.approx((after - before) / (2 * dt), abs=1e-6)


def test_a_long_way_of_a_motor_ends_in_the_assembly_mode_of_home():
    chain = robots.four_bar()
    relay, way = Relay(chain), 3.0
    relay.states({"crank": chain.home[0] + way}, {})
    slow = sst_pin.coordinate_motion(
        chain, np.linspace(0, 1, 101), chain.home[0] + way * np.linspace(0, 1, 101)[:, None]
    )
    assert relay.q == pytest.approx(slow.q[-1], abs=1e-9)


def test_what_cannot_be_relayed_is_named_and_changes_nothing():
    chain = robots.five_bar()
    relay = Relay(chain)
    before = relay.q.copy()
    for positions in ({"shoulder_1": 0.1}, {"shoulder_1": 0.1, "shoulder_2": np.nan}):
        with pytest.raises(sst_pin.InputError, match="no number for shoulder_2"):
            relay.states(positions, {})
    with pytest.raises(sst_pin.ClosureError):  # the elbows cannot meet
        relay.states({"shoulder_1": 3.0, "shoulder_2": 0.0}, {})
    assert np.array_equal(relay.q, before)


def test_the_node_publishes_what_it_computes_with_the_time_of_the_measurement(monkeypatch):
    """ROS is stood in for by the four calls that the node makes."""
    published, called = [], {}
    node = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=published.append),
        create_subscription=lambda kind, topic, hear, depth: called.update(hear=hear),
        create_timer=lambda period, publish: called.update(publish=publish, period=period),
    )
    message = lambda: SimpleNamespace(header=SimpleNamespace(stamp=None))  # noqa: E731
    rclpy = SimpleNamespace(
        init=lambda args: None, create_node=lambda name: node, spin=lambda node: None
    )
    monkeypatch.setitem(sys.modules, "rclpy", rclpy)
    messages = SimpleNamespace(msg=SimpleNamespace(JointState=message))
    monkeypatch.setitem(sys.modules, "sensor_msgs", messages)
    monkeypatch.setitem(sys.modules, "sensor_msgs.msg", messages.msg)
    joint_state_relay.main([str(sst_pin.URDF_PATH), "--rate", "50"])
    assert called["period"] == 0.02
    called["publish"]()
    assert published == []  # nothing is heard yet
    heard = SimpleNamespace(
        header=SimpleNamespace(stamp=7.5),
        name=["gamma_3", "gamma_2", "gamma_1"],
        position=[0.9, 0.8, 0.7],
        velocity=[],
    )
    called["hear"](heard)
    called["publish"]()
    (result,) = published
    assert result.header.stamp == 7.5
    assert dict(zip(result.name, result.position, strict=True))["gamma_3"] == pytest.approx(0.9)
    assert result.velocity == [0.0] * len(result.name)
