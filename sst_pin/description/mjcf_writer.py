# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain as MJCF, the format of MuJoCo."""

from pathlib import Path

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import DescriptionWarning, warn_caller
from ..files import require_ending, text_writer, write_files
from ..model.mechanism import Mechanism
from .mjcf_document import MjcfDocument
from .mjcf_equalities import MjcfEqualities
from .mjcf_forces import add_contacts, add_lines, add_motors


def write_mjcf(chain: ClosedChain, path: str | Path, force: bool = False) -> None:
    """Write a robot as a closed MJCF, which MuJoCo simulates and `ClosedChain.from_mjcf` reads.

    Args:
        chain: The robot; its home and other named configurations become keyframes.
        path: The file, its ending .xml or .mjcf.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: If the robot has parts that MJCF cannot express: rolling contacts,
            universal, cylindrical, prismatic and planar closures, helical and planar joints. The
            message lists all.
        OutputError: If the file cannot be written, or exists.

    Warns:
        DescriptionWarning: If bodies without mass get a little, shapes are left out, or a brake
            becomes an equality that holds at home only.

    Example:
        >>> sst_pin.write_mjcf(sst_pin.robots.five_bar(), "five_bar.xml")
        >>> sst_pin.ClosedChain.from_mjcf("five_bar.xml").motor_names
        ('shoulder_1', 'shoulder_2')
    """
    require_robot("chain", chain)
    require_ending(path, ".xml", ".mjcf")
    poses = chain.mechanism.model.referenceConfigurations
    configurations = {item.key(): item.data() for item in poses}
    if "home" in configurations:
        configurations["home"] = chain.home
    document = closed_mjcf(chain.mechanism, home=configurations.get("home"))
    document.add_shapes(chain.visual_model)
    document.add_keyframes(configurations)
    write_files({Path(path): text_writer(document.text())}, force)
    for note in document.notes:
        warn_caller(f"{path}: {note}", DescriptionWarning)


def closed_mjcf(mechanism: Mechanism, home: Array | None = None) -> MjcfDocument:
    """The MJCF of a mechanism, still without shapes and keyframes.

    Brakes hold at the configuration `home`, shape (nq,); without it they are problems.
    """
    document = MjcfDocument(mechanism)
    document.add_sites()
    add_lines(document, mechanism)
    add_motors(document, mechanism)
    add_contacts(document, mechanism)
    equalities = MjcfEqualities(document, mechanism, home)
    for number, closure in enumerate(mechanism.closures):
        equalities.add(number, closure)
    equalities.add_mimics()
    return document
