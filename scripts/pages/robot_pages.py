# SPDX-License-Identifier: BSD-2-Clause
"""A page for each robot of the gallery: alive, its cuts, mobility and exact torques, code."""

import inspect
import re
from pathlib import Path

import numpy as np

from make_robots_table import reference_torques
from sst_pin import SST, robots
from sst_pin.model.closures import Closure, Coupling, Distance
from sst_pin.robots.gallery_robot import GalleryRobot
from sst_pin.viewer import Viewer
from tests.data import REFERENCE

NAMES = tuple(name for name in robots.__all__ if name.islower())
_WHY = "Each loop is cut once, at a joint without a motor, so that the motors' joints stay in it."
_KINDS = {"6d": "a weld", "3d": "a ball joint", "hinge": "a hinge", "orientation": "equal axes"}


def write_robot_pages(folder: Path) -> None:
    """Write NAME.md and the live page NAME_live.html of each robot, and that of the SST."""
    folder.mkdir(parents=True, exist_ok=True)
    Viewer(SST(), live=True).save(folder / "sst_live.html", force=True)
    for name in NAMES:
        chain = getattr(robots, name)()
        Viewer(chain, live=True).save(folder / f"{name}_live.html", force=True)
        text = page(name, chain, REFERENCE[name]["states"])
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


def page(name: str, chain: GalleryRobot, states: list[dict[str, list[str]]]) -> str:
    """The page of a robot in Markdown."""
    title, _, about = inspect.getdoc(getattr(robots, name)).partition("\n")
    about = re.split(r"^(?:Args|Example):$", about, flags=re.MULTILINE)[0].strip()
    cuts = "\n".join(f"- {_closure(closure)}" for closure in chain.closures)
    closed = f"These close its loops:\n\n{cuts}\n\n{_WHY}" if cuts else "It has no loops.\n"
    torques = "\n".join(_torques(chain, states[:3]))
    return f"""\
# {name}

{title}

<iframe src="{name}_live.html" title="{name}, live" class="live" loading="lazy"></iframe>

Drag the robot or the sliders; *Let go* leaves it to its weight. The equations of this package run \
in the page itself.

{about}

## How it is cut

The tree has {chain.model.njoints - 1} bodies. {closed}

## Mobility

```text
{chain.mobility(chain.home)}
```

## Torques

{torques}

## Code

```python
import sst_pin

chain = sst_pin.robots.{name}()
n = chain.degrees_of_freedom
tau = chain.compute_torques(chain.home, [0.0] * n, [1.0] * n)
```

All dimensions and masses can be changed: [`sst_pin.robots.{name}`](../reference/robots.md).
"""


def _closure(closure: Closure | Distance | Coupling) -> str:
    """A closure in words."""
    if isinstance(closure, Distance):
        return (
            f"a rod of {closure.distance:g} m without mass from `{closure.frame_a}` to "
            f"`{closure.frame_b}`: one equation"
        )
    if isinstance(closure, Coupling):
        return f"{closure}: one equation"
    kind = _KINDS.get(closure.kind, f"a {closure.kind} joint")
    count = len(closure.rows)
    equations = "1 equation" if count == 1 else f"{count} equations"
    return f"{kind} between `{closure.frame_a}` and `{closure.frame_b}`: {equations}"


def _torques(chain: GalleryRobot, states: list[dict[str, list[str]]]) -> list[str]:
    """A table of torques next to the reference data, which have 60 digits."""
    tau, exact = reference_torques(chain, states)
    error = np.abs(tau - exact).max() / np.abs(exact).max()
    table = [["state", *(f"`{motor}`" for motor in chain.motor_names)]]
    table += [["---"] * len(table[0])]
    table += [[str(k), *(f"{value:.12g}" for value in row)] for k, row in enumerate(tau, 1)]
    return [
        f"These are the first {len(tau)} states of the "
        f"[reference data](../evidence.md#reference-data), in N m or N. "
        f"The largest error is {error:.0e} of the largest torque.",
        "",
        *(f"| {' | '.join(row)} |" for row in table),
    ]
