# SPDX-License-Identifier: BSD-2-Clause
"""Closures of a robot as equalities of an MJCF."""

from collections.abc import Sequence
from xml.etree.ElementTree import SubElement

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..model.closures import Brake, Closure, Constraint, Coupling, Distance, Rolling
from ..model.mechanism import Mechanism
from ..model.tree import frame_id, frame_named
from .mjcf_document import MjcfDocument, site_name
from .urdf_writer import numbers

#: Largest degree of MuJoCo's polynomials of joints and tendons.
_MAX_DEGREE = 4
#: Components that a weld and a ball hold: [linear; angular], True where it holds.
_WELD = Closure.KINDS["6d"]
_BALL = Closure.KINDS["3d"]


class MjcfEqualities:
    """Adds the closures of a robot to an MJCF, and couplings of its mimic joints.

    Brakes hold at the configuration `home`, shape (nq,); without it they are problems.
    """

    def __init__(self, document: MjcfDocument, mechanism: Mechanism, home: Array | None) -> None:
        self._document = document
        self._mechanism = mechanism
        self._home = home

    def add(self, number: int, closure: Constraint) -> None:
        """Add a closure, or a problem if MuJoCo has no such closure; `number` is its index."""
        if isinstance(closure, Coupling):
            self._add_coupling(closure)
        elif isinstance(closure, Rolling):
            self._refuse(f"closure {closure}: MuJoCo has no rolling without slip")
        elif isinstance(closure, Brake):
            self._add_brake(closure)
        elif isinstance(closure, Distance):
            self._add_rod(f"rod_{number}", closure)
        else:
            self._add_closure(number, closure)

    def add_mimics(self) -> None:
        """Add an equality for each joint that mimics another one."""
        names = self._document.names_by_rate()
        for joint in self._document.joints:
            if joint.mimics:
                # A mimic joint has no rate of its own: its rate is that of the joint it mimics.
                leader = names[int(joint.rates[0])]
                self._add_polynomial("joint", [joint.name, leader], [joint.offset, joint.factor])

    def _refuse(self, problem: str) -> None:
        self._document.problems.append(problem)

    def _add_polynomial(self, kind: str, names: Sequence[str], powers: Sequence[float]) -> None:
        """Add an equality of joints or tendons with a polynomial P.

        For two names it is first = P(second); for one name it is first = P(0), a constant. The
        values are changes of positions or lengths since MuJoCo's reference configuration, which is
        q = 0.

        Args:
            kind: "joint" or "tendon".
            names: Names of one or two joints or tendons.
            powers: Coefficients of P, the constant first.
        """
        coefficients = np.zeros(_MAX_DEGREE + 1)
        coefficients[: len(powers)] = powers
        ends = {f"{kind}{i}": name for i, name in enumerate(names, 1)}
        equalities = self._document.section("equality")
        SubElement(equalities, kind, ends, polycoef=numbers(coefficients))

    def _add_closure(self, number: int, closure: Closure) -> None:
        """Add a weld or a ball; or a hinge, as a ball and a second ball on its axis.

        MuJoCo's name of a ball is `connect`.
        """
        components = closure.held  # six booleans, as in `_WELD` and `_BALL`
        is_hinge = all(components[:3]) and components.count(False) == 1
        if components == _WELD:
            self._connect(number, "weld", closure.frame_a, closure.frame_b)
        elif components == _BALL:
            self._connect(number, "connect", closure.frame_a, closure.frame_b)
        elif is_hinge:
            self._connect(number, "connect", closure.frame_a, closure.frame_b)
            axis = components.index(False) - 3  # 0, 1 or 2: the free rotation is about x, y or z
            on_axis_a = self._add_site_on_axis(number, closure.frame_a, axis)
            on_axis_b = self._add_site_on_axis(number, closure.frame_b, axis)
            self._connect(number, "connect", on_axis_a, on_axis_b)
        else:
            words = closure.kind if isinstance(closure.kind, str) else "of these directions"
            self._refuse(f"closure {closure}: MuJoCo has no closure {words}")

    def _connect(self, number: int, kind: str, frame_a: str, frame_b: str) -> None:
        """Connect the sites at two frames, for the closure of this index.

        `kind` is "weld" or "connect". `frame_a` and `frame_b` are names of frames, or names that
        `_add_site_on_axis` returns: `site_name` makes the names of sites in the file from both.
        """
        equalities = self._document.section("equality")
        names = {equality.get("name") for equality in equalities}
        name = f"{frame_a}-{frame_b}"
        while name in names:  # another closure between these frames has the name
            name = f"{name}_{number}"
        attributes = {"name": name, "site1": site_name(frame_a), "site2": site_name(frame_b)}
        SubElement(equalities, kind, attributes)

    def _add_site_on_axis(self, number: int, frame_name: str, axis: int) -> str:
        """Add a site on the axis x, y or z of an end of a closure; returns its name for `_connect`.

        `number` is the index of the closure, `axis` is 0, 1 or 2. The site's distance from the
        origin is the robot's length, so that both points together hold the direction of the axis as
        accurately as the position of the origin.
        """
        offset = pin.SE3(np.eye(3), self._mechanism.length * np.eye(3)[axis])
        frame = frame_named(self._document.model, frame_name)
        site = f"{frame_name}_axis_{number}"
        self._document.add_site(site, frame.parentJoint, frame.placement * offset)
        return site

    def _add_rod(self, name: str, rod: Distance) -> None:
        """Add a tendon of constant length."""
        self._document.add_line_tendon({"name": name}, rod.frame_a, rod.frame_b)
        at_zero = self._distance(rod.frame_a, rod.frame_b, pin.neutral(self._mechanism.model))
        self._add_polynomial("tendon", [name], [rod.distance - at_zero])

    def _add_brake(self, brake: Brake) -> None:
        """Hold a joint or a line where it is at `home`."""
        home = self._home
        if home is None:
            text = "MuJoCo holds at one position only; name a configuration home"
            self._refuse(f"{brake}: {text}")
            return
        rate = self._mechanism.rate_of(brake)  # None for a brake that holds a line
        if rate is not None:
            name = self._document.names_by_rate().get(rate)
            if name is None:
                text = "MuJoCo holds no single rate of a ball or a free joint; use hinges in series"
                self._refuse(f"{brake}: {text}")
                return
            (joint,) = (joint for joint in self._document.joints if joint.name == name)
            self._add_polynomial("joint", [name], [float(joint.qpos(home)[0])])
        else:
            assert brake.frames is not None
            # `add_lines` has written the line as a tendon, which has the name of the brake.
            at_zero = self._distance(*brake.frames, pin.neutral(self._mechanism.model))
            change = self._distance(*brake.frames, home) - at_zero
            self._add_polynomial("tendon", [brake.name], [change])
        text = "written as an equality, which holds it at home only"
        self._document.notes.append(f"{brake}: {text}")

    def _distance(self, frame_a: str, frame_b: str, q: Array) -> float:
        """Distance of the origins of two frames at a configuration, [m]."""
        model = self._mechanism.model
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        a = data.oMf[frame_id(model, frame_a)].translation
        b = data.oMf[frame_id(model, frame_b)].translation
        return float(np.linalg.norm(b - a))

    def _add_coupling(self, coupling: Coupling) -> None:
        """Add a coupling: follower = offset + sum of p_j(q_j), with polynomials p_j.

        An equality of MuJoCo has a polynomial of one joint or tendon, the argument. So at most one
        p_j may be nonlinear. Its joint is the argument, and the other joints, whose polynomials are
        linear, go to the left side:

            follower - sum of slope_j q_j over the others = polynomial of the argument.

        If the left side has several joints, both sides become tendons, because an equality of
        joints has one joint on the left.
        """
        # Coefficients of each p_j, the constant first, without zeros at the end. They are empty for
        # a p_j that is zero.
        polynomials = {name: np.trim_zeros(p, "b") for name, p in coupling.polynomials.items()}
        nonlinear = [name for name, powers in polynomials.items() if len(powers) > 2]
        degree = max((len(powers) for powers in polynomials.values()), default=0) - 1
        names_of_joints = {joint.name for joint in self._document.joints}
        has_all_joints = names_of_joints >= set(polynomials)
        if len(nonlinear) > 1 or degree > _MAX_DEGREE or not has_all_joints:
            text = "MuJoCo has polynomials of one joint, up to the fourth power"
            self._refuse(f"coupling {coupling}: {text}")
            return

        # The argument is the joint with the nonlinear polynomial, or the first joint if all are
        # linear; a zero polynomial counts as linear. This list has one name, or none if there are
        # no polynomials: then the follower is constant.
        arguments = nonlinear or list(polynomials)[:1]
        left_side = {coupling.joint: 1.0}
        right_side = np.zeros(_MAX_DEGREE + 1)  # coefficients, the constant first
        right_side[0] = coupling.offset
        for name, powers in polynomials.items():
            if not len(powers):  # the polynomial is zero
                continue
            right_side[0] += powers[0]
            if name in arguments:
                right_side[1 : len(powers)] = powers[1:]
            elif len(powers) > 1:
                left_side[name] = -powers[1]

        if len(left_side) == 1:
            self._add_polynomial("joint", [coupling.joint, *arguments], right_side.tolist())
            return
        # Both sides become tendons, whose names are numbered over the whole file.
        count = len(self._document.root.findall("tendon/fixed"))
        sides = [self._document.add_sum_tendon(f"sum_{count}", left_side)]
        for name in arguments:
            sides.append(self._document.add_sum_tendon(f"sum_{count + 1}", {name: 1.0}))
        self._add_polynomial("tendon", sides, right_side.tolist())
