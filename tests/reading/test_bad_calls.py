# SPDX-License-Identifier: BSD-2-Clause
"""Readers refuse what is no path, no names and no motors."""

import pytest

import sst_pin
from sst_pin import ClosedChain
from tests.support.bad_calls import NOT_PATHS, faults
from tests.support.files import ROOT

DELTA = ROOT / "examples" / "delta.urdf"
READERS = {
    "from_urdf": (ClosedChain.from_urdf, DELTA),
    "from_mjcf": (ClosedChain.from_mjcf, sst_pin.sst.MJCF_PATH),
    "SST.from_urdf": (sst_pin.SST.from_urdf, sst_pin.URDF_PATH),
    "load": (sst_pin.load, sst_pin.URDF_PATH),
}


@pytest.mark.parametrize("name", READERS)
def test_readers_refuse_bad_arguments(name, here):
    (here / "file").write_text("x")
    read, path = READERS[name]
    assert faults(read, {"path": path, "urdf": path}) == []


def test_closures_are_written_to_files(here):
    (here / "file").write_text("x")
    good = {"chain": sst_pin.robots.four_bar(), "path": "a.yaml"}
    assert faults(sst_pin.write_loop_closures, good) == []


@pytest.mark.parametrize("path", [path for path in NOT_PATHS if path is not None])
def test_validate_names_what_is_no_path(path, here):
    try:
        problems = sst_pin.validate(path)
    except sst_pin.SSTError:
        return
    assert [problem.where for problem in problems] == ["file"]
