# SPDX-License-Identifier: BSD-2-Clause
"""PyTorch differentiates torques and steps of many robots by the derivative kernels.

Tensors go to Warp and back without copies. The joints of a closed chain follow its coordinates. So
gradients by q have entries for the coordinates only; the others are zero. The coordinates must be
the motors, each with one entry of q, and the joints must have as many rates as entries of q.

    pip install 'sst-pin[gpu]' torch
    python examples/gpu_gradients.py
"""

import torch
import warp as wp

import sst_pin


def shared(*tensors):
    """Arrays of Warp in the memory of tensors."""
    return [wp.from_torch(x.detach()) for x in tensors]


class Quantity(torch.autograd.Function):
    """A quantity of q, va and a third argument, by its kernel and that of its derivatives."""

    @staticmethod
    def forward(ctx, compute, slopes, coordinates, *states):
        """Values, shape (N, n)."""
        ctx.slopes = slopes
        ctx.coordinates = coordinates
        ctx.save_for_backward(*states)
        return wp.to_torch(compute(*shared(*states)))

    @staticmethod
    def backward(ctx, gradient):
        """Gradients by the states."""
        slopes = map(wp.to_torch, ctx.slopes(*shared(*ctx.saved_tensors)))
        by_coordinates, *others = (torch.einsum("ni,nij->nj", gradient, x) for x in slopes)
        by_q = torch.zeros_like(ctx.saved_tensors[0])
        by_q[:, ctx.coordinates] = by_coordinates
        return None, None, None, by_q, *others


class Step(torch.autograd.Function):
    """A step by its kernel; the derivative is that of the Runge-Kutta method."""

    @staticmethod
    def forward(ctx, robot, dt, *states):
        """The next q and va."""
        ctx.robot = robot
        ctx.dt = dt
        ctx.save_for_backward(*states)
        q, va, tau = shared(*states)
        return tuple(map(wp.to_torch, robot.batch.step((q, va), tau, dt)))

    @staticmethod
    def backward(ctx, *gradients):
        """Gradients by the states."""
        with torch.enable_grad():
            states = [x.detach().requires_grad_() for x in ctx.saved_tensors]
            end = ctx.robot.runge_kutta(*states, ctx.dt)
            return None, None, *torch.autograd.grad(end, states, gradients)


class Robot:
    """Differentiable dynamics of many robots of one kind, on tensors of shapes (N, ...)."""

    def __init__(self, chain, device=None):
        self.batch = chain.warp(device)
        places = [chain.position_names.index(name) for name in chain.coordinates]
        self.coordinates = torch.tensor(places, device=wp.device_to_torch(self.batch.device))

    def torques(self, q, va, aa):
        """Motor torques of motions, shape (N, motors)."""
        kernels = self.batch.torques, self.batch.torque_derivatives
        return Quantity.apply(*kernels, self.coordinates, q, va, aa)

    def accelerations(self, q, va, tau):
        """Accelerations of the coordinates, shape (N, n)."""
        kernels = self.batch.accelerations, self.batch.acceleration_derivatives
        return Quantity.apply(*kernels, self.coordinates, q, va, tau)

    def step(self, q, va, tau, dt):
        """q and va after a step with constant torques."""
        return Step.apply(self, dt, q, va, tau)

    def moved(self, q, rates, dt):
        """The closed configuration when the coordinates have moved by `rates * dt`."""
        way = wp.to_torch(self.batch.rates(*shared(q, rates))) * dt
        closed = wp.to_torch(self.batch.closed(*shared(q + way)))
        own = q[:, self.coordinates] + rates * dt
        return closed.index_copy(1, self.coordinates, own)

    def runge_kutta(self, q, va, tau, dt):
        """A step as PyTorch differentiates it."""
        rates = [va]
        slopes = [self.accelerations(q, va, tau)]
        for ahead in (dt / 2, dt / 2, dt):
            stage = self.moved(q, rates[-1], ahead), va + ahead * slopes[-1]
            rates.append(stage[1])
            slopes.append(self.accelerations(*stage, tau))
        mean, slope = ((x[0] + 2 * x[1] + 2 * x[2] + x[3]) / 6 for x in (rates, slopes))
        return self.moved(q, mean, dt), va + dt * slope


def main():
    """Find torques that bring five-bars to rest after ten steps, by gradients."""
    chain = sst_pin.robots.five_bar()
    robot = Robot(chain)
    count = 16
    dt = 0.01
    torch.manual_seed(0)
    device = robot.coordinates.device
    q0 = torch.tensor(chain.home, device=device).repeat(count, 1)
    va0 = torch.randn(count, 2, dtype=q0.dtype, device=device)
    tau = torch.zeros(10, count, 2, dtype=q0.dtype, device=device, requires_grad=True)
    optimiser = torch.optim.LBFGS([tau], line_search_fn="strong_wolfe")

    def loss():
        optimiser.zero_grad()
        q = q0
        va = va0
        for k in range(len(tau)):
            q, va = robot.step(q, va, tau[k], dt)
        value = (va**2).sum()
        value.backward()
        return value

    before = loss().item()
    optimiser.step(loss)
    print(f"sum of the squares of the rates: {before:.3g}, then {loss().item():.2g}")


if __name__ == "__main__":
    main()
