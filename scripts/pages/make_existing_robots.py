# SPDX-License-Identifier: BSD-2-Clause
"""Write the table of docs/existing_robots.md from other people's files.

The folder holds clones of their repositories, under the repositories' names:
example-parallel-robots (Gepetto), generalized_rbda (ROAM-Lab-ND), mujoco_menagerie
(google-deepmind), pal_mjlab (pal-robotics), placo-examples (Rhoban). Rows of a repository that is
not there stay as they are.

    python scripts/pages/make_existing_robots.py FOLDER
"""

import argparse
from functools import partial
from pathlib import Path
from typing import NamedTuple

import sst_pin
from make_robots_table import COUNTS, counts
from markdown_tables import Table, rewrite
from sst_pin import ClosedChain
from sst_pin.verification.verify import verify_chain

PAGE = Path(__file__).resolve().parents[2] / "docs" / "existing_robots.md"
HEADER = ("robot", *COUNTS, "forces off by", "accelerations off by", "what to know")
LAAS = "example-parallel-robots/robots"
GRBDA = "generalized_rbda/robot-models"
KANGAROO = "pal_mjlab/src/pal_mjlab/robots/pal_kangaroo/xmls/kangaroo.xml"
LEG = ("1_joint", "2_joint", "3_joint", "4_joint", "5_joint", "length_joint")
SPINS = "rods and feet on three hinges spin"


class Robot(NamedTuple):
    """A file, what the reader is told besides, and what there is to know of it."""

    path: str
    remark: str = ""
    locked: tuple[str, ...] = ()
    actuated: tuple[str, ...] | None = None


ROBOTS = (
    Robot(
        f"{LAAS}/5bar_linkage",
        "both ends of the loop turn, on a link of 1e-9 kg: `locked=` holds one; bodies of 654 t",
        ("closedloop1_A",),
    ),
    Robot(f"{LAAS}/5bar_linkage_iso3d"),
    Robot(f"{LAAS}/5bar_linkage_iso6d"),
    Robot(f"{LAAS}/battobot_6d"),
    Robot(f"{LAAS}/cassie_like", SPINS),
    Robot(
        f"{LAAS}/digit_like",
        f"{SPINS}: three are held by `locked=`",
        ("hip_x_toe_a_2/2_rev2", "foot_part_toe_b_1/2_2_rev2", "foot_part_toe_b_1/2_rev2"),
    ),
    Robot(f"{LAAS}/digit_like_2legs"),
    Robot(f"{LAAS}/digit_like_2legs_6D"),
    Robot(f"{LAAS}/digit_like_2legs_old"),
    Robot(f"{LAAS}/disney_like", SPINS),
    Robot(
        f"{LAAS}/disney_robot",
        "the URDF calls a joint left_s\u0125erical_free_foot, the YAML left_spherical_free_foot: "
        "with one name for it, it runs",
    ),
    Robot(
        f"{LAAS}/kangaroo_like",
        "closures 2, 7, 8, 9, 10, each by itself, stay open by 0.5 to 32 mm or mrad: put their "
        "frames right",
    ),
    Robot(f"{LAAS}/kangaroo_like_2leg", "no YAML: it is an open tree; write the closures"),
    Robot(
        f"{LAAS}/kangaroo_like_2legs",
        "ten closures, each by itself, stay open by 0.3 to 29 mm: put right",
    ),
    Robot(f"{LAAS}/robot_delta", "two of three motors, and rods that spin"),
    Robot(f"{LAAS}/talos_like", SPINS),
    Robot(
        f"{LAAS}/true_talos_2_legs",
        "two spins are held by `locked=`, with them free accelerations are not confirmed; "
        "fingers that mimic have motors",
        tuple(f"leg_{s}_5_link_leg_{s}_foot_free_link_rev0" for s in ("left", "right")),
    ),
    Robot(f"{LAAS}/wl16_like", SPINS),
    Robot(
        "mujoco_menagerie/agility_cassie/cassie.xml",
        "floats on springs; the Achilles rods are balls at both ends",
    ),
    Robot("mujoco_menagerie/robotiq_2f85/2f85.xml", "springs; a tendon is the motor"),
    Robot(
        KANGAROO,
        "floats; the file has no actuators: `actuated=` names the legs'",
        actuated=tuple(f"leg_{side}_{name}" for side in ("left", "right") for name in LEG),
    ),
    Robot(
        "placo-examples/models/orbita",
        "closures are marked by frames; `actuated=` names the motors",
        actuated=("ring1", "ring2", "ring3"),
    ),
    Robot(f"{GRBDA}/four_bar.urdf", "URDF+"),
    Robot(f"{GRBDA}/six_bar.urdf", "URDF+"),
    Robot(f"{GRBDA}/planar_leg_linkage.urdf", "URDF+"),
    Robot(f"{GRBDA}/jvrc1_humanoid.urdf", "URDF+: gears as `<coupling>`"),
)


def read(robot: Robot, folder: Path) -> ClosedChain:
    """The robot as its file has it."""
    path = folder / robot.path
    if path.suffix == ".xml":
        return ClosedChain.from_mjcf(path, locked=robot.locked, actuated=robot.actuated)
    (urdf,) = [path] if path.suffix == ".urdf" else path.glob("*.urdf")
    own = path / "robot.yaml"  # whatever the name of the URDF
    cuts = own if own.is_file() else None
    return ClosedChain.from_urdf(urdf, cuts, locked=robot.locked, actuated=robot.actuated)


def _row(robot: Robot, folder: Path) -> tuple[str, ...]:
    name = f"`{Path(robot.path).stem}`"
    try:
        chain = read(robot, folder)
        report = chain.mobility()
    except (sst_pin.DescriptionError, sst_pin.ClosureError) as error:
        print(f"{name}: {error}")
        return (name, *["-"] * (len(HEADER) - 2), f"refused: {robot.remark}")
    *_, forces, accelerations = verify_chain(chain)
    errors = [f"{line.relative:.0e}" for line in (forces, accelerations)]
    print(f"{name}: {', '.join(errors)}")
    return (name, *counts(chain, report), *errors, robot.remark)


def table(folder: Path, stands: Table) -> Table:
    """Rows of robots that are there, the others as they stand."""
    known, rows = {row[0]: row for row in stands}, [HEADER]
    for robot in ROBOTS:
        there = (folder / robot.path).exists()
        rows.append(_row(robot, folder) if there else known[f"`{Path(robot.path).stem}`"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    rewrite(PAGE, {"existing": partial(table, folder)})


if __name__ == "__main__":
    main()
