# SPDX-License-Identifier: BSD-2-Clause
"""What editors and type checkers see of the package after `pip install -e`."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import jedi
import pytest

import sst_pin

ROOT = Path(__file__).resolve().parents[2]
#: A user's file: what is right, then two mistakes.
USE = """\
import sst_pin

robot = sst_pin.SST()
chain = sst_pin.robots.delta(platform_mass=0.3)
print(robot.compute_torques(robot.home, [0, 0, 0], [1, 0, 0]), chain.mobility())
sst_pin.compute_torques
robot.compute_torque
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Python of an environment with an editable installation, its dependencies lent."""
    folder = tmp_path_factory.mktemp("editable")
    venv.create(folder / "env")
    site = folder / "env" / "lib" / f"python{sysconfig.get_python_version()}" / "site-packages"
    lent = [path for path in sys.path if "site-packages" in path]
    (site / "lent.pth").write_text("\n".join(lent))
    python = folder / "env" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-index", "--no-deps"]
    command = [*pip, "--no-build-isolation", "-e", ROOT]
    subprocess.run(command, check=True, capture_output=True)
    return python


@pytest.mark.parametrize("line", ["sst_pin.", "sst_pin.robots.", "robot."])
def test_jedi_completes_a_session(line):
    robot = sst_pin.SST()
    found = jedi.Interpreter(line, [{"sst_pin": sst_pin, "robot": robot}]).complete()
    names = {completion.name for completion in found if completion.name[0] != "_"}
    wanted = {"sst_pin.": set(sst_pin.__all__), "sst_pin.robots.": set(sst_pin.robots.__all__)}
    assert wanted.get(line, {"compute_torques", "home"}) <= names
    if line == "sst_pin.robots.":
        assert names == wanted[line]


@pytest.mark.slow
def test_mypy_finds_the_package_and_both_mistakes(python, tmp_path):
    (tmp_path / "use.py").write_text(USE)
    command = [sys.executable, "-m", "mypy", "--python-executable", python, "use.py"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    wrong = [line.split(":")[1] for line in result.stdout.splitlines() if ": error:" in line]
    assert wrong == ["6", "7"], result.stdout
