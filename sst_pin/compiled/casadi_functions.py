# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of a chain as functions of CasADi, for its optimisers and integrators."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import casadi as ca
from casadi import MX, SX, Function

from ..arrays import Array
from ..chain.mechanism import Mechanism
from ..chain.reference import Reference
from ..chain.runge_kutta import runge_kutta_step
from ..chain.tree import frame_named
from ..errors import ActuationError
from . import build, kernels
from .compiled_backend import sample_configurations
from .elimination import Orthogonal
from .equations import Equations
from .kernel_checks import Checks
from .link_kinematics import Point

#: Common subexpressions are computed once.
_OPTIONS = {"cse": True}
_WRENCHES = "external_wrenches"


class CasadiFunctions:
    """Dynamics of one chain as `casadi.Function`s, with the numbers of now folded in.

    q is a configuration of the whole tree, shape (nq,), as everywhere: its entries are independent
    variables here. The functions also have values where the loops are open, which mean nothing, and
    so the derivative by a single entry of q means nothing. What means something is where
    `residual(q)` is 0 and along `tangent(q)`. So let q be a variable of a nonlinear program, with
    `residual(q) == 0` among its constraints; or integrate `q_rates`, or chain `step`s, which stay
    on the closures. docs/derivatives.md has examples.

    Every function is made when it is first asked for, pickles, takes numbers, `SX` and `MX`, and
    has derivatives of every order; compiled ones have those of first order, and pickle for this
    machine and user. Coulomb friction is smooth. Nothing here looks at the samples, save `check`:
    next to a singularity numbers grow without an error.

    Attributes:
        nq, n, motors: Numbers of entries in q, va, tau.
    """

    def __init__(
        self,
        reference: Reference,
        near: Array | None,
        sign_width: float,
        loaded: bool = False,
        compiled: bool = False,
    ) -> None:
        self._compiled = compiled
        samples = sample_configurations(reference, near)
        self._mechanism: Mechanism = reference.mechanism
        self._equations = Equations(self._mechanism, samples, loaded, smooth=True)
        self._equations.factors  # noqa: B018  (or says that the coordinates do not fix the motion)
        friction = replace(self._mechanism.friction, sign_width=sign_width)
        self._numbers = self._equations.parameters.pack(self._mechanism, friction)
        self._bodies = self._mechanism.model.njoints - 1 if loaded else 0
        self.nq = self._mechanism.model.nq
        self.n, self.motors = len(self._mechanism.coordinates), self._mechanism.motors.shape[1]

    def __repr__(self) -> str:
        sizes = f"nq={self.nq}, n={self.n}, motors={self.motors}"
        return f"CasadiFunctions({self._mechanism.model.name}: {sizes})"

    @cached_property
    def torques(self) -> Function:
        """(q, va, aa) -> tau: as `compute_torques`; with redundant motors the smallest torques.

        Raises:
            ActuationError: If the motors do not act on all coordinates.
        """
        if self.motors < self.n:
            raise ActuationError(
                f"{self.motors} motors for {self.n} coordinates; use generalized_forces"
            )
        return self._function("torques", ["q", "va", "aa"], "tau")

    @cached_property
    def generalized_forces(self) -> Function:
        """(q, va, aa) -> f, shape (n,): generalized forces of the motion."""
        return self._function("forces", ["q", "va", "aa"], "f")

    @cached_property
    def accelerations(self) -> Function:
        """(q, va, tau) -> aa: direct dynamics."""
        return self._function("accelerations", ["q", "va", "tau"], "aa")

    @cached_property
    def rates(self) -> Function:
        """(q, va) -> v, shape (nv,): rates of all joints, L va."""
        return self._function("rates", ["q", "va"], "v")

    @cached_property
    def q_rates(self) -> Function:
        """(q, va) -> q_dot, shape (nq,): rates of the entries of q, also of quaternions."""
        e = self._equations
        return self._made("q_rates", {"q": e.q, "va": e.va}, {"q_dot": e.kinematics.q_rates(e.v)})

    @cached_property
    def tangent(self) -> Function:
        """Q -> T, shape (nq, n), with q_dot = T va.

        If J is CasADi's derivative of a function with respect to q, its derivative along the closed
        motions is J T.
        """
        e = self._equations
        columns = [e.kinematics.q_rates(L) for L in e.L]
        return self._made("tangent", {"q": e.q}, {"T": ca.horzcat(*columns)})

    @cached_property
    def residual(self) -> Function:
        """Q -> r: zero if the loops are closed; independent rows only, [m] and [rad].

        The rows are independent closure constraints, and |u|^2 - 1 of the unit vectors in q
        (quaternions, cosine-sine pairs). Redundant rows, and constraints on rates only (rolling),
        are left out. With these rows alone a loop can also close in a wrong way (a hinge turned by
        half a turn): check results with `chain.residual`, which has all rows. Where no choice of
        rows is independent everywhere (Bennett's linkage), all rows are combined to as many
        numbers as the loop has dependent rates.
        """
        e = self._equations
        residuals = {i: e.rows[i].residual for i in sorted(e.factors.rows)}
        left = {i: row for i, row in residuals.items() if row is not None}
        combined: list[SX] = []
        for part in e.factors.parts:
            if isinstance(part, Orthogonal):
                own = part.solve({i: left.pop(i) for i in part.rows if i in left})
                combined += own.values()
        gaps = [*left.values(), *combined, *e.kinematics.unit_gaps]
        return self._made("residual", {"q": e.q}, {"r": ca.vertcat(*gaps)})

    @cached_property
    def check(self) -> Function:
        """Q -> c: above 1 (or NaN) where the functions cannot be trusted at q.

        The loops are open there, or q is too far from the configurations for which the order of
        elimination was chosen, next to a singularity.
        """
        checks = Checks(self._equations)
        worst = ca.mmax(ca.vertcat(*checks.of_state, *checks.of_complement))
        return self._made("check", {"q": self._equations.q}, {"c": worst})

    @cached_property
    def torque_derivatives(self) -> Function:
        """(q, va, aa) -> dq, dva, daa: as `torque_derivatives` of the chain, shapes (n, n)."""
        names = ["dq", "dva", "daa"]
        return self._derivatives("torque_derivatives", ["q", "va", "aa"], names)

    @cached_property
    def acceleration_derivatives(self) -> Function:
        """(q, va, tau) -> dq, dva, dtau: as `acceleration_derivatives` of the chain."""
        names = ["dq", "dva", "dtau"]
        return self._derivatives("acceleration_derivatives", ["q", "va", "tau"], names)

    @cached_property
    def step(self) -> Function:
        """(q, va, tau, dt) -> q_next, va_next: a step of `rollout` with constant tau.

        It is a step of the classical Runge-Kutta method of order four, then one step of Newton's
        method that closes the loops.
        """
        state_rate = self._function("state_rate", ["q", "va", "tau"], "rate")
        closing = kernels.make(self._equations, "closing")
        closed = self._made(
            "closing", {"q": self._equations.q}, {"closed": closing.output[: self.nq]}
        )
        given = {"q": MX.sym("q", self.nq), "va": MX.sym("va", self.n)}
        rest = {"tau": MX.sym("tau", self.motors)}
        if self._bodies:
            rest[_WRENCHES] = MX.sym(_WRENCHES, self._bodies, 6)

        def rate(when: int, x: MX) -> MX:
            return state_rate(x[: self.nq], x[self.nq :], *rest.values())

        x, dt = ca.vertcat(*given.values()), MX.sym("dt")
        x = runge_kutta_step(rate, x, dt)
        given |= {"tau": rest.pop("tau"), "dt": dt} | rest
        results = [closed(x[: self.nq]), x[self.nq :]]
        names = list(given), ["q_next", "va_next"]
        return Function("step", list(given.values()), results, *names)

    def frame_placement(self, frame: str) -> Function:
        """Q -> p, shape (3,), and R, shape (3, 3): a frame, by its name, in the base."""
        e, point = self._equations, self._point(frame)
        return self._made("frame_placement", {"q": e.q}, {"p": point.p, "R": point.R})

    def frame_jacobian(self, frame: str) -> Function:
        """Q -> J, shape (6, n): the chain's `frame_jacobian` of a frame, by its name."""
        rows = kernels.make(self._equations, "frame_jacobian", frame=frame).output
        J = ca.reshape(rows, self.n, 6).T
        return self._made("frame_jacobian", {"q": self._equations.q}, {"J": J})

    # --- inside -----------------------------------------------------------------------------

    def _point(self, frame: str) -> Point:
        named = frame_named(self._mechanism.model, frame)
        return self._equations.kinematics.point(0, named)

    def _function(self, kernel: str, inputs: list[str], output: str) -> Function:
        """A kernel as a function."""
        made = kernels.make(self._equations, kernel)
        return self._made(kernel, self._named(made, inputs), {output: made.output})

    def _derivatives(self, kernel: str, inputs: list[str], outputs: list[str]) -> Function:
        """A kernel of derivatives as a function of three results."""
        made = kernels.make(self._equations, kernel)
        side_by_side = ca.reshape(made.output, -1, self.n).T
        parts = ca.horzsplit(side_by_side, [0, self.n, 2 * self.n, side_by_side.shape[1]])
        named = self._named(made, inputs)
        return self._made(kernel, named, dict(zip(outputs, parts, strict=True)), order=0)

    def _named(self, made: kernels.SymbolicKernel, inputs: list[str]) -> dict[str, SX]:
        """Inputs of a kernel by name."""
        if len(made.inputs) > len(inputs):
            inputs = [*inputs, _WRENCHES]
        return dict(zip(inputs, made.inputs, strict=True))

    def _made(
        self, name: str, inputs: dict[str, SX], outputs: dict[str, SX], order: int = 1
    ) -> Function:
        """A function with the numbers put in; it takes wrenches as the chain does, body by body.

        Where it is compiled, with derivatives up to an order.
        """
        symbols = [*inputs.values(), self._equations.p]
        results = [ca.densify(x) for x in outputs.values()]
        open_numbers = Function(name, symbols, results, _OPTIONS)
        given = dict(inputs)
        values: list[SX] = list(inputs.values())
        if _WRENCHES in inputs:
            given[_WRENCHES] = SX.sym(_WRENCHES, self._bodies, 6)
            values[-1] = ca.vec(given[_WRENCHES].T)
        results = open_numbers.call([*values, SX(self._numbers)])
        names = list(given), list(outputs)
        function = Function(name, list(given.values()), results, *names, _OPTIONS)
        if not self._compiled:
            return function
        return _compiled(self._mechanism.model.name, function, order)


def _compiled(robot: str, function: Function, order: int) -> Function:
    """A function as an external one, from the cache or compiled now, with a Jacobian if `order`."""
    name, content = function.name(), f"{order} {function.serialize()}".encode()

    def source() -> str:
        generator = ca.CodeGenerator(name)
        for one in [function, function.jacobian()] if order else [function]:
            generator.add(one)
        return str(generator.dump())

    library = build.library(robot, f"casadi_{name}", content, "scalar", source)
    return ca.external(name, library._name)
