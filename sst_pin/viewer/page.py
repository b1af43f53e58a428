# SPDX-License-Identifier: BSD-2-Clause
"""The page that a browser shows: Meshcat's scene, torque curves beside it, in one file."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from importlib.resources import files
from typing import Any


def page(
    commands: Iterable[bytes], panel: dict[str, Any], functions: str = "", served: bool = False
) -> str:
    """HTML that needs nothing from outside.

    Args:
        commands: Commands of Meshcat, packed.
        panel: What the scripts show: title, times, curves, layers, how to play.
        functions: JavaScript of the robot's functions, for a page that answers.
        served: Whether the page asks its server for more.
    """
    parts = {
        "MESHCAT": (files("meshcat") / "viewer/dist/main.min.js").read_text(encoding="utf-8"),
        "STYLE": _asset("panel.css"),
        "STAGE": _asset("stage.js"),
        "CHART": _asset("chart.js"),
        "PANEL": _asset("panel.js"),
        "LIVE": functions + _asset("live.js") if functions else "const live = null;",
        "SCENE": json.dumps(
            {
                "served": served,
                "commands": [base64.b64encode(command).decode() for command in commands],
                "panel": panel,
            }
        ).replace("</", "<\\/"),
    }
    html = _asset("panel.html")
    for name, text in parts.items():
        html = html.replace(f"/*{name}*/", text)
    return html


def _asset(name: str) -> str:
    return (files(__package__) / "assets" / name).read_text(encoding="utf-8")
