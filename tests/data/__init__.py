# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that tests and pages compare with."""

import json
from pathlib import Path
from typing import Any

#: Ten states of the SST and of each robot, to 40 digits; see README.md here.
REFERENCE_PATH = Path(__file__).with_name("reference.json")
REFERENCE: dict[str, dict[str, Any]] = json.loads(REFERENCE_PATH.read_text(encoding="utf-8"))
#: For each standard problem: rates at the start, torques, and what is published at time t.
#: "forces" are what the body of this joint takes from that of theta where they meet, base axes.
PUBLISHED: dict[str, dict[str, Any]] = json.loads(
    Path(__file__).with_name("published.json").read_text(encoding="utf-8")
)
