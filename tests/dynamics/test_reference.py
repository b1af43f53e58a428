# SPDX-License-Identifier: BSD-2-Clause
"""The reference path is short: files in one order, none entered twice."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import sst_pin

ROOT = Path(sst_pin.__file__).parent
#: Checks and errors that any file may call.
NOT_COUNTED = {"arrays", "errors"}


def files_entered(chain):
    """Files of the package in the order in which calls from other files first enter them."""
    n = len(chain.coordinates)
    motion = chain.home, np.full(n, 0.1), np.full(n, 0.2)
    chain.compute_torques(*motion)  # computes what is computed once
    files = []

    def note(frame, event, _):
        path, caller = frame.f_code.co_filename, frame.f_back and frame.f_back.f_code.co_filename
        if event == "call" and path.startswith(str(ROOT)) and path != caller:
            name = Path(path).relative_to(ROOT).with_suffix("").as_posix()
            if name not in NOT_COUNTED and name not in files:
                files.append(name)

    sys.setprofile(note)
    try:
        chain.compute_torques(*motion)
    finally:
        sys.setprofile(None)
    return files


def test_the_page_lists_the_files_from_the_call_to_the_dynamics():
    page = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    _, listed = page.split("<!-- files of the reference path -->")
    names = re.findall(r"^\d+\. `([\w/]+)`", listed, re.MULTILINE)
    plain = sst_pin.robots.four_bar()
    assert names == files_entered(plain)
    of_quaternions = files_entered(sst_pin.robots.delta())
    assert of_quaternions == [*names[:7], "model/joint_space", *names[7:]]
    friction = sst_pin.ClosedChain(
        plain.model, plain.closures, ["crank"], viscous_friction=np.full(3, 0.1)
    )
    assert files_entered(friction) == [*names, "model/mechanism", "model/dry_friction"]


def test_an_argument_by_name_that_is_not_finite_is_named():
    chain = sst_pin.robots.four_bar()
    with pytest.raises(sst_pin.InputError, match=r"^va: entry \[0\] is nan"):
        chain.engine.reference.rates(q=chain.home, va=np.array([np.nan]))
