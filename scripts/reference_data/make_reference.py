# SPDX-License-Identifier: BSD-2-Clause
"""Write tests/data/reference.json: ten states of each robot, exact to 40 digits.

    python scripts/reference_data/make_reference.py [ROBOT ...]

takes a few minutes; with names, only these robots are computed anew.
"""

import json
import random
import sys
from concurrent.futures import ProcessPoolExecutor

from mpmath import mp, mpf, nstr

import sst_pin
from exact_dynamics import ExactRobot
from plain_numbers import describe
from tests.data import REFERENCE, REFERENCE_PATH
from tests.gallery import EVERY_ROBOT

STATES = 10
DIGITS = 40


def chains():
    """The SST and the gallery by name."""
    return {"sst": sst_pin.SST()} | {name: build() for name, build in EVERY_ROBOT.items()}


def states_of(name, record, home, count=STATES):
    """Random states near home with their dynamics."""
    mp.dps = 60
    robot = ExactRobot(record)
    numbers = random.Random(name)

    def decimals(count, width):
        return [mpf(repr(round(numbers.uniform(-width, width), 3))) for _ in range(count)]

    n = len(robot.coordinates)
    states = []
    for _ in range(count):
        q = robot.moved_from([mpf(x) for x in home], decimals(n, 0.05))
        motion = robot.state(q, decimals(n, 1), decimals(n, 2))
        torques = motion.torques()
        given = [mpf(nstr(torque, 2)) for torque in torques]
        kinetic, potential = motion.energies()
        states.append(
            {
                "q": printed(motion.q),
                "v": printed(motion.v),
                "dv": printed(motion.dv),
                "torques": printed(torques),
                "kinetic_energy": nstr(kinetic, DIGITS),
                "potential_energy": nstr(potential, DIGITS),
                "given_torques": printed(given),
                "accelerations": printed(motion.accelerations(given)),
            }
        )
    return states


def printed(values):
    return [nstr(value, DIGITS) for value in values]


def main(wanted):
    """Compute and write."""
    with ProcessPoolExecutor(2) as pool:
        jobs = {}
        for name, chain in chains().items():
            if not wanted or name in wanted:
                record = describe(chain)
                home = [float(x) for x in chain.home]
                jobs[name] = record, pool.submit(states_of, name, record, home)
        data = dict(REFERENCE) if wanted else {}
        for name, (record, states) in jobs.items():
            data[name] = {**record, "states": states.result()}
            print(name, flush=True)
    # One line for each joint, closure and state.
    lines = []
    for name, robot in sorted(data.items()):
        parts = []
        for key, value in robot.items():
            if key in ("joints", "closures", "forces", "states") and value:
                rows = ",\n".join("  " + json.dumps(row) for row in value)
                parts.append(f" {json.dumps(key)}: [\n{rows}\n ]")
            else:
                parts.append(f" {json.dumps(key)}: {json.dumps(value)}")
        lines.append(f"{json.dumps(name)}: {{\n" + ",\n".join(parts) + "\n}")
    REFERENCE_PATH.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
