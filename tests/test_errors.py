# SPDX-License-Identifier: BSD-2-Clause
"""Messages of the errors say how to heal them."""

import shlex
import shutil
import sys
from pathlib import Path

import pytest

from sst_pin import errors


@pytest.mark.parametrize("clone", [True, False])
@pytest.mark.parametrize("inside", [True, False])
def test_the_printed_command_installs_into_the_python_that_runs(
    clone, inside, tmp_path, monkeypatch
):
    """From any folder, and from a clone if the package runs from one."""
    folder = tmp_path / "the package"
    (folder / "sst_pin").mkdir(parents=True)
    module = folder / "sst_pin" / "errors.py"
    shutil.copy(errors.__file__, module)
    if clone:
        (folder / "setup.py").touch()
    monkeypatch.setattr(errors, "__file__", str(module))
    monkeypatch.chdir(folder if inside else tmp_path)
    command = str(errors.MissingExtraError("meshcat", "viz")).partition("run: ")[2]
    python, *words, target = shlex.split(command)
    assert python == sys.executable
    assert words == (["-m", "pip", "install", "-e"] if clone else ["-m", "pip", "install"])
    place, _, extra = target.partition("[")
    assert extra == "viz]"
    assert Path(place).resolve() == folder if clone else place == "sst-pin"
