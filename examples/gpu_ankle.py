# SPDX-License-Identifier: BSD-2-Clause
"""Which gains of a position controller suit many ankles, each with its own foot and friction?

Thousands of parallel ankles with random masses and friction follow random poses of the foot at the
same time, each with gains of its own. The best gains are those whose neighbours do well, too.

    pip install 'sst-pin[gpu]'
    python examples/gpu_ankle.py --device cuda            # 4096 legs
    python examples/gpu_ankle.py --device cpu --legs 64 --seconds 0.3
"""

import argparse
from time import perf_counter

import numpy as np
import warp as wp

import sst_pin

#: Period of the controller, [s]; the simulation takes SUBSTEPS steps in it.
PERIOD, SUBSTEPS = 0.002, 2
#: A leg gets a new target after so many periods.
HOLD = 100
#: Largest torque of a motor, [N m].
LIMIT = 40.0


@wp.kernel
def follow(
    q: wp.array2d(dtype=wp.float64),
    va: wp.array2d(dtype=wp.float64),
    target: wp.array2d(dtype=wp.float64),
    gains: wp.array2d(dtype=wp.float64),
    places: wp.array1d(dtype=int),
    limit: wp.float64,
    tau: wp.array2d(dtype=wp.float64),
    cost: wp.array1d(dtype=wp.float64),
):
    """Torques of a controller with saturation, and the sum of the squares of its errors."""
    leg = wp.tid()
    for k in range(places.shape[0]):
        error = target[leg, k] - q[leg, places[k]]
        wanted = gains[leg, 0] * error - gains[leg, 1] * va[leg, k]
        tau[leg, k] = wp.clamp(wanted, -limit, limit)
        cost[leg] += error * error


@wp.kernel
def restart(
    status: wp.array1d(dtype=int),
    home: wp.array1d(dtype=wp.float64),
    q: wp.array2d(dtype=wp.float64),
    va: wp.array2d(dtype=wp.float64),
    fallen: wp.array1d(dtype=int),
):
    """Put legs whose step is bad back to rest at home, and count them."""
    leg = wp.tid()
    if status[leg] != 0:
        fallen[leg] += 1
        for k in range(home.shape[0]):
            q[leg, k] = home[k]
        for k in range(va.shape[1]):
            va[leg, k] = wp.float64(0.0)


class Ankles:
    """Many ankles on one device, as an environment for learning.

    Attributes:
        q, va: States, shapes (legs, nq) and (legs, n).
        cost: Sum of the squares of the errors of each leg, shape (legs,), [rad^2].
        fallen: How often each leg was put back, shape (legs,).
    """

    def __init__(self, legs, device=None, seed=0):
        self.random = np.random.default_rng(seed)
        bare = sst_pin.robots.ankle()
        model, friction = bare.model, np.zeros(bare.model.nv)
        model.armature[bare.motor_indices] = 0.02  # rotors behind the gears
        friction[bare.motor_indices] = 0.5
        self.chain = sst_pin.ClosedChain(
            model, bare.closures, bare.motor_names,
            viscous_friction=0.2 * friction, coulomb_friction=friction,
        )  # fmt: skip
        self.legs = legs
        self.home = bare.home
        self.batch = self.chain.warp(device).with_parameters(self.parameters())
        self.device = self.batch.device
        self.start = self.array(self.home)
        self.places = wp.array(bare.motor_indices, dtype=int, device=self.device)
        self.q, self.va = self.array(np.tile(self.home, (legs, 1))), self.array(np.zeros((legs, 2)))
        self.tau, self.target = self.array(np.zeros((legs, 2))), self.array(np.zeros((legs, 2)))
        self.cost = self.array(np.zeros(legs))
        self.status, self.fallen = (wp.zeros(legs, dtype=int, device=self.device) for _ in range(2))

    def array(self, values):
        """Numbers on the device."""
        return wp.array(values, dtype=wp.float64, device=self.device)

    def parameters(self):
        """Parameters of each leg: feet from half to twice the mass, friction up to twice."""
        batch = self.chain.warp("cpu")
        names = batch.parameter_names
        numbers = batch.parameters.numpy()
        numbers = np.repeat(numbers, self.legs, axis=0)
        foot = [i for i, name in enumerate(names) if name.startswith("ankle_roll.")]
        rubbing = [i for i, name in enumerate(names) if name.endswith(("viscous", "coulomb"))]
        numbers[:, foot] *= self.random.uniform(0.5, 2.0, (self.legs, 1))
        numbers[:, rubbing] *= self.random.uniform(0.0, 2.0, (self.legs, 1))
        return numbers

    def new_targets(self):
        """Positions of the motors that turn each foot to a random pitch and roll."""
        turned = self.random.uniform(-0.25, 0.25, (self.legs, 2))
        self.target.assign(self.home[self.chain.motor_indices] + turned)

    def step(self, gains):
        """One period of the controller."""
        inputs = [self.q, self.va, self.target, gains, self.places, LIMIT, self.tau, self.cost]
        wp.launch(follow, self.legs, inputs=inputs, device=self.device)
        state = self.q, self.va
        self.batch.step(state, self.tau, PERIOD, substeps=SUBSTEPS, out=state, status=self.status)
        inputs = [self.status, self.start, self.q, self.va, self.fallen]
        wp.launch(restart, self.legs, inputs=inputs, device=self.device)


def search(legs, seconds, device=None):
    """Random gains, shape (legs, 2), their mean squared errors, number of bad steps, seconds."""
    ankles = Ankles(legs, device)
    gains = 10 ** ankles.random.uniform([0.5, -1.5], [2.5, 1.0], (legs, 2))
    on_device = ankles.array(gains)
    periods = round(seconds / PERIOD)
    ankles.new_targets()
    ankles.step(on_device)  # compiles
    wp.synchronize()
    start = perf_counter()
    for period in range(1, periods):
        if period % HOLD == 0:
            ankles.new_targets()
        ankles.step(on_device)
    wp.synchronize()
    took = perf_counter() - start
    return gains, ankles.cost.numpy() / periods, int(ankles.fallen.numpy().sum()), took


def main():
    """Search and print the best gains."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", help="by default Warp's preferred one")
    parser.add_argument("--legs", type=int, default=4096)
    parser.add_argument("--seconds", type=float, default=2.0)
    options = parser.parse_args()
    gains, cost, fallen, took = search(options.legs, options.seconds, options.device)
    best = np.argsort(cost)[: max(options.legs // 20, 1)]
    kp, kd = np.exp(np.log(gains[best]).mean(axis=0))
    steps = options.legs * round(options.seconds / PERIOD) * SUBSTEPS
    print(f"best gains: kp = {kp:.1f} N m/rad, kd = {kd:.2f} N m s/rad")
    print(
        f"RMS error {np.sqrt(cost[best].mean() / 2):.4f} rad; of all {np.sqrt(cost.mean() / 2):.4f}"
    )
    print(f"{fallen} bad steps of {steps}; {steps / took:.3g} steps a second")


if __name__ == "__main__":
    main()
