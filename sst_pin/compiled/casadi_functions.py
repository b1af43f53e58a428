# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics of a chain as functions of CasADi, for its optimisers and integrators."""

from dataclasses import replace
from functools import cached_property

import casadi as ca
from casadi import MX, SX, Function

from ..arrays import Array
from ..dynamics.reference import Reference
from ..dynamics.runge_kutta import runge_kutta_step
from ..model.tree import frame_named
from ..progress import announced
from . import kernels, libraries
from .elimination import Orthogonal
from .equations import Equations
from .generator_inputs import sample_configurations
from .kernel_checks import CLOSED, Checks
from .kernels import WRENCHES

#: Common subexpressions are computed once.
_OPTIONS = {"cse": True}


class CasadiFunctions:
    """Dynamics of one chain as `casadi.Function`s, with its present numbers as constants.

    The entries of q, shape (nq,), are independent variables here. Values are valid only where
    `residual(q)` is 0, and derivatives by q only along `tangent(q)`, not by a single entry of q. In
    a nonlinear program, make q a variable and `residual(q) == 0` a constraint. Otherwise integrate
    `q_rates`, or use `step` repeatedly, which stays on the closures. docs/optimal_control.md has
    examples.

    Every function is made at its first use, can be pickled, takes numbers, `SX` and `MX`, and has
    derivatives of every order. Coulomb friction is smooth. Only `check` and `torques_check` check
    the input: next to a singularity numbers grow without an error.

    Compiled functions have derivatives of first order only, and compiled `torque_derivatives` and
    `acceleration_derivatives` have none. Pickles of compiled functions are for this machine and
    user.

    Args:
        reference: Reference path of the chain.
        near: Configuration near which the order of elimination is chosen, shape (nq,), or None.
        sign_width: Coulomb friction has tanh(v / sign_width) for the sign of a rate v.
        loaded: Whether external wrenches are the last input, shape (bodies, 6).
        compiled: Whether the functions are compiled C code.

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
        self._mechanism = mechanism = reference.mechanism
        self.nq = mechanism.model.nq
        self.n = len(mechanism.coordinates)
        self.motors = mechanism.motor_count
        self._compiled = compiled
        samples = sample_configurations(reference, near)
        self._equations = Equations(mechanism, samples, loaded, smooth=True)
        # This chooses the pivots now, so that the constructor refuses coordinates that do not
        # determine the motion.
        self._Phi_u = self._equations.factors
        friction = replace(mechanism.friction, sign_width=sign_width)
        self._numbers = self._equations.parameters.pack(mechanism, friction)
        self._bodies = mechanism.model.njoints - 1 if loaded else 0

    def __repr__(self) -> str:
        sizes = f"nq={self.nq}, n={self.n}, motors={self.motors}"
        return f"CasadiFunctions({self._mechanism.model.name}: {sizes})"

    @cached_property
    def torques(self) -> Function:
        """(q, va, aa) -> tau: as `compute_torques`; with redundant motors the smallest torques.

        Raises:
            ActuationError: If the motors do not act on all coordinates.
        """
        return self._function("torques", "tau")

    @cached_property
    def generalized_forces(self) -> Function:
        """(q, va, aa) -> f, shape (n,): generalized forces of the motion."""
        return self._function("generalized_forces", "f")

    @cached_property
    def accelerations(self) -> Function:
        """(q, va, tau) -> aa: direct dynamics.

        Raises:
            SingularConfigurationError: If a motion moves no mass.
        """
        self._mechanism.require_mass()
        return self._function("accelerations", "aa")

    @cached_property
    def rates(self) -> Function:
        """(q, va) -> v, shape (nv,): rates of all joints, L va."""
        return self._function("rates", "v")

    @cached_property
    def q_rates(self) -> Function:
        """(q, va) -> q_dot, shape (nq,): rates of the entries of q, also of quaternions."""
        e = self._equations
        return self._with_numbers(
            "q_rates", {"q": e.q, "va": e.va}, {"q_dot": e.kinematics.q_rates(e.v)}
        )

    @cached_property
    def tangent(self) -> Function:
        """(q) -> T, shape (nq, n), with q_dot = T va.

        If J is CasADi's derivative of a function with respect to q, its derivative along the closed
        motions is J T.
        """
        e = self._equations
        columns = [e.kinematics.q_rates(L) for L in e.L]
        return self._with_numbers("tangent", {"q": e.q}, {"T": ca.horzcat(*columns)})

    @cached_property
    def residual(self) -> Function:
        """(q) -> r: zero if the loops are closed; independent rows only, [m] and [rad].

        The entries are independent closure constraints, then |u|^2 - 1 of the unit vectors u in q
        (quaternions, cosine-sine pairs). Constraints on rates only (rolling) have no entry. If no
        choice of rows of a loop is independent everywhere (Bennett's linkage), all its rows are
        combined to as many numbers as the loop has dependent rates.

        A loop can also close in a wrong way (a hinge turned by half a turn): check results with
        `chain.residual`, which has all rows.
        """
        e = self._equations
        of_rows: dict[int, SX] = {}  # rows that constrain rates only have no residual
        for i in sorted(self._Phi_u.rows):
            residual = e.rows[i].residual
            if residual is not None:
                of_rows[i] = residual
        # A part of the class `Orthogonal` combines all its rows by least squares, because no choice
        # of them is independent everywhere.
        combined: dict[int, SX] = {}  # by dependent rate
        rows_of_combined = set[int]()
        for part in self._Phi_u.parts:
            if isinstance(part, Orthogonal):
                combined |= part.solve({i: of_rows[i] for i in part.rows if i in of_rows})
                rows_of_combined.update(part.rows)
        independent = [x for i, x in of_rows.items() if i not in rows_of_combined]
        gaps = [*independent, *combined.values(), *e.kinematics.unit_gaps]
        return self._with_numbers("residual", {"q": e.q}, {"r": ca.vertcat(*gaps)})

    @cached_property
    def check(self) -> Function:
        """(q) -> c: above 1 (or NaN) where the functions cannot be trusted at q.

        Either the loops are open, or q is near a singularity or too far from the configurations for
        which the order of elimination was chosen, or the motors hardly hold the robot.
        """
        checks = Checks(self._equations, CLOSED)
        of_motors = []
        if self._equations.driven:
            of_motors = checks.of_motors
        verdicts = ca.vertcat(*checks.of_state, *checks.of_complement, *of_motors)
        return self._with_numbers("check", {"q": self._equations.q}, {"c": ca.mmax(verdicts)})

    @cached_property
    def torques_check(self) -> Function:
        """(q, va, aa) -> c: above 1 (or NaN) where `torques` of this motion cannot be trusted.

        The reasons are those of `check`, and one more: torques that balance each other may be so
        large that their rounding is not small beside the forces that the motion needs.

        Raises:
            ActuationError: As `torques`.
        """
        kernel = kernels.make(self._equations, "torques")
        return self._with_numbers("torques_check", kernel.inputs, {"c": ca.mmax(kernel.checks)})

    @cached_property
    def torque_derivatives(self) -> Function:
        """(q, va, aa) -> dq, dva, daa: as `torque_derivatives` of the chain, shapes (n, n)."""
        return self._derivatives("torque_derivatives", "dq", "dva", "daa")

    @cached_property
    def acceleration_derivatives(self) -> Function:
        """(q, va, tau) -> dq, dva, dtau: as `acceleration_derivatives` of the chain."""
        self._mechanism.require_mass()
        return self._derivatives("acceleration_derivatives", "dq", "dva", "dtau")

    @cached_property
    def step(self) -> Function:
        """(q, va, tau, dt) -> q_next, va_next: a step of `rollout` with constant tau.

        It is a step of the classical Runge-Kutta method of order four, then one step of Newton's
        method that closes the loops.
        """
        self._mechanism.require_mass()
        nq = self.nq
        rate = self._function("state_rate", "rate")
        q_next = kernels.make(self._equations, "closing").output[:nq]
        closed = self._with_numbers("closing", {"q": self._equations.q}, {"closed": q_next})
        sizes = {"q": nq, "va": self.n, "tau": self.motors, "dt": 1}
        q, va, tau, dt = (MX.sym(name, size) for name, size in sizes.items())
        loads = [MX.sym(WRENCHES, self._bodies, 6)] if self._bodies else []

        def of_state(_: int, x: MX) -> MX:
            return rate(x[:nq], x[nq:], tau, *loads)

        x = runge_kutta_step(of_state, ca.vertcat(q, va), dt)
        arguments = [q, va, tau, dt, *loads]
        names = [symbol.name() for symbol in arguments], ["q_next", "va_next"]
        return Function("step", arguments, [closed(x[:nq]), x[nq:]], *names)

    def frame_placement(self, frame: str) -> Function:
        """(q) -> p, shape (3,), and R, shape (3, 3): a frame, by its name, in the base."""
        e = self._equations
        point = e.kinematics.moving_frame(0, frame_named(self._mechanism.model, frame))
        return self._with_numbers("frame_placement", {"q": e.q}, {"p": point.p, "R": point.R})

    def frame_jacobian(self, frame: str) -> Function:
        """(q) -> J, shape (6, n): the chain's `frame_jacobian` of a frame, by its name."""
        rows = kernels.make(self._equations, "frame_jacobian", frame=frame).output
        J = ca.reshape(rows, self.n, 6).T  # `reshape` fills columns first
        return self._with_numbers("frame_jacobian", {"q": self._equations.q}, {"J": J})

    # --- inside -----------------------------------------------------------------------------

    @announced("casadi: deriving the equations")
    def _function(self, quantity: str, output: str) -> Function:
        """The function of a quantity, with a name for its result."""
        kernel = kernels.make(self._equations, quantity)
        return self._with_numbers(quantity, kernel.inputs, {output: kernel.output})

    @announced("casadi: deriving the equations")
    def _derivatives(self, quantity: str, by_q: str, by_va: str, by_last: str) -> Function:
        """The function of three derivatives, with names for these."""
        kernel = kernels.make(self._equations, quantity)
        # The result of the kernel is the matrix [by_q, by_va, by_last] with n rows, row by row.
        # CasADi's `reshape` fills columns first, hence the transpose.
        side_by_side = ca.reshape(kernel.output, -1, self.n).T
        starts = [0, self.n, 2 * self.n, side_by_side.shape[1]]
        parts = ca.horzsplit(side_by_side, starts)
        results = dict(zip((by_q, by_va, by_last), parts, strict=True))
        return self._with_numbers(quantity, kernel.inputs, results, has_jacobian=False)

    def _with_numbers(
        self,
        name: str,
        inputs: dict[str, SX],
        outputs: dict[str, SX],
        *,
        has_jacobian: bool = True,
    ) -> Function:
        """A function of expressions, with the present numbers of the robot for the symbols p.

        It takes wrenches as the chain does, shape (bodies, 6). A compiled function can have a
        compiled Jacobian.
        """
        symbols = [*inputs.values(), self._equations.p]
        results = [ca.densify(x) for x in outputs.values()]
        of_symbols = Function(name, symbols, results, _OPTIONS)
        arguments: dict[str, SX] = {}
        values: list[SX] = []  # of the inputs, from the arguments
        for input_name, of_input in inputs.items():
            if input_name == WRENCHES:
                arguments[input_name] = SX.sym(WRENCHES, self._bodies, 6)
                values.append(ca.vec(arguments[input_name].T))
            else:
                arguments[input_name] = of_input
                values.append(of_input)
        results = of_symbols.call([*values, SX(self._numbers)])
        names = list(arguments), list(outputs)
        function = Function(name, list(arguments.values()), results, *names, _OPTIONS)
        if not self._compiled:
            return function
        return _compiled(self._mechanism.model.name, function, has_jacobian=has_jacobian)


def _compiled(robot: str, function: Function, *, has_jacobian: bool) -> Function:
    """The function in compiled code, from the cache or compiled now.

    With `has_jacobian` its derivative of first order is compiled too.
    """
    name = function.name()
    content = f"{int(has_jacobian)} {function.serialize()}".encode()

    def sources() -> list[str]:
        generator = ca.CodeGenerator(name)
        generator.add(function)
        if has_jacobian:
            generator.add(function.jacobian())
        return [str(generator.dump())]

    library = libraries.load(robot, f"casadi_{name}", content, "scalar", sources)
    return ca.external(name, library._name)
