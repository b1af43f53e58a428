# SPDX-License-Identifier: BSD-2-Clause
"""Robots and good arguments that bad calls are made of."""

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import sst_pin
from sst_pin.verification.sampling import random_states
from tests.support import link_tables

#: What is no path of a file that can be written or read.
ODD_PATHS: dict[str, Any] = {
    "None": None,
    "number": 5,
    "empty": "",
    "a folder": ".",
    "below a device": "/dev/null/all.csv",
    "NUL": "a\0b.csv",
    "300 letters": "a" * 300 + ".csv",
    "bytes": b"a.csv",
    "list": ["a.csv"],
    "other ending": "a.txt",
    "no ending": "a",
    "only an ending": ".csv",
    "below a file": "file/a.csv",
    "surrogate": "\udcff\ud800.csv",
}


class World:
    """Made once in each process, in an empty folder."""

    @cached_property
    def robot(self):
        """A robot with compiled kernels, where they are."""
        return sst_pin.SST()

    @cached_property
    def reference(self):
        return sst_pin.SST(kernels=False)

    @cached_property
    def table_of_four_bar(self):
        return link_tables.four_bar()

    @cached_property
    def chain(self):
        """A four-bar, one motor."""
        return self.table_of_four_bar.chain()

    @cached_property
    def chain_state(self):
        """q, va, aa, tau of the four-bar by virtual work."""
        table = self.table_of_four_bar
        none = np.zeros((len(table.links), 6))
        motion = table.motion(table.x, np.full(1, 0.3), np.full(1, -0.4), none)
        return motion.q, motion.va, motion.aa, motion.tau

    @cached_property
    def star_states(self):
        """R, omega, alpha of four random states."""
        return random_states(self.robot, np.random.default_rng(0), 4)

    @cached_property
    def states(self):
        """q, va, aa of the same states."""
        return self.robot.joint_motion(*self.star_states)

    @cached_property
    def tau(self):
        """Their torques by the reference path."""
        return self.reference.compute_torques(*self.states)

    @cached_property
    def motion(self):
        """The start of the paper's circle, ten samples."""
        from sst_pin.sst.paper import example_1

        return example_1(self.robot, np.linspace(0, 0.05, 10))

    @cached_property
    def open_motion(self):
        """The motion with its loops open."""
        m = self.motion
        q = m.q + 0.1 * np.arange(9)
        return sst_pin.Trajectory(m.t, q, m.va, m.aa, m.tau, m.joint_names, m.actuated)

    @cached_property
    def motion_of_another(self):
        """A motion of a robot with other joints."""
        rates = [np.ones((2, 1))] * 3
        names = ("lift", "boom", "bucket")
        return sst_pin.Trajectory([0.0, 1.0], np.ones((2, 3)), *rates, names, ("lift",))

    @cached_property
    def urdf(self):
        return Path(sst_pin.URDF_PATH).read_text(encoding="utf-8")

    @cached_property
    def cuts(self):
        return Path(sst_pin.YAML_PATH).read_text(encoding="utf-8")

    def described(self, urdf=None, cuts=None, name="robot"):
        """A URDF with its cuts in the working folder."""
        path = Path(f"{name}.urdf")
        path.write_text(self.urdf if urdf is None else urdf, encoding="utf-8")
        path.with_suffix(".yaml").write_text(self.cuts if cuts is None else cuts, encoding="utf-8")
        return path
