# SPDX-License-Identifier: BSD-2-Clause
"""An extension module that is missing or old is refused, with the cure."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sst_pin
from sst_pin.compiled import extension

PACKAGE = Path(sst_pin.__file__).parent
#: Refused by `compile` twice, in a package and in a clone, then torques; no other clone is on the
#: path.
CODE = """
import os, sys
sys.path[:] = [p for p in sys.path if p == "" or not os.path.isdir(f"{p}/sst_pin")]
import sst_pin
robot = sst_pin.robots.four_bar()
for _ in range(2):
    try:
        robot.compile()
    except sst_pin.CompilationError as error:
        print(error)
    open("setup.py", "w").close()
print(robot.compute_torques(robot.home, [1], [0]).round(3))
"""


def test_without_the_extension_compile_says_the_cure_and_the_reference_path_computes(tmp_path):
    skipped = shutil.ignore_patterns("*.so", "__pycache__")
    shutil.copytree(PACKAGE, tmp_path / "sst_pin", ignore=skipped)
    command = [sys.executable, "-c", CODE]
    printed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    *errors, torques = printed.stdout.splitlines()
    assert len(errors) == 2
    for said, clone in zip(errors, (False, True), strict=True):
        assert said.startswith(f"the extension module is not compiled in {tmp_path / 'sst_pin'}; ")
        assert "a C compiler and Python's headers" in said
        assert ("-m pip install -e ." in said) == clone
        assert ("start Python outside the clone" in said) == clone
    assert torques == "[0.166]"


def test_an_extension_of_other_sources_is_refused(monkeypatch, tmp_path):
    """As of a clone that was updated; one without its sources beside it is loaded."""
    sources = [tmp_path / source.name for source in extension._SOURCES]
    monkeypatch.setattr(extension, "_SOURCES", sources)
    load = extension.binding.__wrapped__
    assert load()
    for source, copy in zip(("_binding.pyx", "batches.h"), sources, strict=True):
        shutil.copy(PACKAGE / "compiled" / source, copy)
    assert load()
    sources[-1].write_text(sources[-1].read_text() + " ")
    with pytest.raises(sst_pin.CompilationError, match=r"other sources.*pip install -e"):
        load()
