# SPDX-License-Identifier: BSD-2-Clause
"""A clone that hides an installed package says so."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import sst_pin
from sst_pin import extensions

PACKAGE = Path(sst_pin.__file__).parent
#: Two robots, where no other clone is on the path.
CODE = """
import os, sys
own = "", os.environ["PYTHONPATH"]
sys.path[:] = [p for p in sys.path if p in own or not os.path.isdir(f"{p}/sst_pin")]
import sst_pin
print(sst_pin.SST().path)
print(sst_pin.SST().path)
"""


@pytest.mark.parametrize("installed", ["compiled", "not compiled", ""])
def test_a_clone_without_extensions_tells_of_the_installation_that_it_hides(tmp_path, installed):
    """It warns once and in the path, with what helps; else it asks for a compiler."""
    clone, site = tmp_path / "clone", tmp_path / "site"
    shutil.copytree(
        PACKAGE, clone / "sst_pin", ignore=shutil.ignore_patterns("*.so", "__pycache__")
    )
    (clone / "setup.py").touch()
    (clone / "urdf").symlink_to(Path(sst_pin.URDF_PATH).parent)
    if installed:
        (site / "sst_pin" / "compiled").mkdir(parents=True)
        (site / "sst_pin" / "__init__.py").touch()
        if installed == "compiled":
            (site / "sst_pin" / "compiled" / "_binding.so").touch()
        (site / "sst_pin-0.dist-info").mkdir()
        (site / "sst_pin-0.dist-info" / "METADATA").write_text("Name: sst-pin\nVersion: 0\n")
    command = [sys.executable, "-c", CODE]
    environment = os.environ | {"PYTHONPATH": str(site)}
    environment.pop("SST_PIN_KERNELS", None)
    result = subprocess.run(
        command, cwd=clone, env=environment, capture_output=True, text=True, check=True
    )
    path, again = result.stdout.splitlines()
    assert path == again
    assert path.startswith("the reference path: ")
    hides = f"imports sst_pin from {clone / 'sst_pin'}, where it is not compiled"
    cure = "start Python in another folder, or pip install -e ."
    assert (hides in path and str(site) in path) == bool(installed)
    assert result.stderr.count(f"RuntimeWarning: Python {hides}") == bool(installed)
    assert path.endswith(cure) == (installed == "compiled")
    assert ("install sst-pin with a C compiler" in path) == (installed != "compiled")


@pytest.mark.parametrize("there", [True, False])
def test_the_headers_of_python_are_asked_for_where_they_are_not(tmp_path, monkeypatch, there):
    if there:
        (tmp_path / "Python.h").touch()
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    monkeypatch.setattr("importlib.metadata.distributions", lambda **_: ())
    assert ("python3-dev" in extensions.missing.__wrapped__()) != there
