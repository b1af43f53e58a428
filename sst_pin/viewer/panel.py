# SPDX-License-Identifier: BSD-2-Clause
"""The HTML page of a robot, and the warnings in its panel.

The page is `assets/panel.html`, in which the scripts and data replace marks such as `/*SCENE*/`.
"""

import base64
import json
from collections.abc import Iterable
from importlib.resources import files
from typing import Any

import numpy as np

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..simulation.check import samples_of
from ..simulation.trajectories import Trajectory


def page(
    commands: Iterable[bytes], panel: dict[str, Any], functions: str = "", served: bool = False
) -> str:
    """HTML of a page that needs no other files.

    Args:
        commands: Packed commands of Meshcat, which draw the scene.
        panel: Data of the panel, with the names of `panel.js`.
        functions: JavaScript of a live page; empty for other pages.
        served: Whether the page gets updates from a server.
    """
    packed = [base64.b64encode(command).decode() for command in commands]
    scene = json.dumps({"served": served, "commands": packed, "panel": panel})
    parts = {
        "MESHCAT": (files("meshcat") / "viewer/dist/main.min.js").read_text(encoding="utf-8"),
        "STYLE": _asset("panel.css"),
        "STAGE": _asset("stage.js"),
        "CHART": _asset("chart.js"),
        "PANEL": _asset("panel.js"),
        "LIVE": functions + _asset("live.js") if functions else "const live = null;",
        "SCENE": scene.replace("</", "<\\/"),  # a text "</script>" would end the script
    }
    html = _asset("panel.html")
    for name, text in parts.items():
        html = html.replace(f"/*{name}*/", text)
    return html


def _asset(name: str) -> str:
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")


def warnings_of(robot: ClosedChain, motion: Trajectory | Array) -> list[str]:
    """Warnings of a motion or configuration: open loops, then findings of `check_limits`."""
    t, q = samples_of(robot.mechanism, motion)  # t is NaN for a configuration
    lines = []
    # How far the loops are open at each sample; zero within the tolerance.
    residuals = np.abs(robot.residual(q)).max(axis=1, initial=0.0)
    residuals[robot.engine.loops.are_closed(q)] = 0.0
    worst = int(residuals.argmax())
    if residuals[worst]:
        when = "" if np.isnan(t[worst]) else f" at t = {t[worst]:.6g} s"
        lines.append(f"the loops are open by {residuals[worst]:.3g} (m or rad){when}")
    return lines + [str(finding) for finding in robot.check_limits(motion)]
