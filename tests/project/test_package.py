# SPDX-License-Identifier: BSD-2-Clause
"""What a stranger meets: the installed package, the README, the public names."""

import json
import re
import subprocess
import sys
import sysconfig
import tarfile
import venv
from pathlib import Path
from zipfile import ZipFile

import jedi
import pytest

import sst_pin
from tests.support.files import ROOT, load

README = (ROOT / "README.md").read_text(encoding="utf-8")


PYTHON = re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def run_python(code, *options, python=sys.executable, **how):
    """What Python code prints in a process of its own."""
    command = [python, *options, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, **how).stdout


@pytest.mark.slow
def test_wheel_of_the_source_archive_brings_the_robot_into_an_empty_environment(tmp_path):
    """Built, installed elsewhere, loaded from there: URDF, cuts, meshes and kernels are inside."""
    build = [sys.executable, "-m", "build", "--no-isolation", "-o", tmp_path, ROOT]
    subprocess.run(build, check=True, capture_output=True)  # the wheel from the source archive
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as sources:
        packed = {name.partition("/")[2] for name in sources.getnames()}
    git = ["git", "-C", ROOT, "ls-files"]
    tracked = subprocess.run(git, capture_output=True, text=True, check=False).stdout.splitlines()
    assert set(tracked) - {".gitignore"} <= packed  # nothing is tracked outside of a clone
    assert not [name for name in packed if name.endswith((".so", ".pyc"))]
    (wheel,) = tmp_path.glob("*.whl")
    with ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        shown = archive.read(metadata).decode()
    assert "Description-Content-Type: text/markdown" in shown
    assert "## Your own robot" in shown
    links = re.findall(r"\]\(([^)]+)\)", re.sub(r"```.*?```", "", shown, flags=re.DOTALL))
    assert links
    assert all(link.startswith("https://") for link in links)  # an index has no files beside it
    venv.create(tmp_path / "env")
    python = tmp_path / "env" / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-index", "--no-deps"]
    subprocess.run([*pip, wheel], check=True, capture_output=True)
    # Its dependencies are lent by this environment, which must not lend the sources.
    lent = [p for p in sys.path if "site-packages" in p and Path(p) != ROOT]
    version = f"python{sysconfig.get_python_version()}"
    (tmp_path / "env" / "lib" / version / "site-packages" / "lent.pth").write_text("\n".join(lent))
    code = (
        "import sst_pin; print(sst_pin.__file__); print(sst_pin.URDF_PATH); "
        "import sst_pin.verification.lagrange; "
        "robot = sst_pin.SST(); print(robot.compute_torques(robot.home, [0]*3, [0]*3)); "
        "robot.compile(); print(robot.backend)"
    )
    printed = run_python(code, "-I", python=python, cwd=tmp_path)
    module, urdf, torques, path = printed.splitlines()
    assert path.startswith("compiled kernels")
    assert Path(module).is_relative_to(tmp_path / "env")
    assert Path(urdf).is_relative_to(tmp_path / "env")
    inside, shipped = Path(urdf).parent, ROOT / "urdf"
    assert [p.relative_to(inside) for p in sorted(inside.rglob("*"))] == [
        p.relative_to(shipped) for p in sorted(shipped.rglob("*"))
    ]
    home = sst_pin.SST().home
    assert torques == str(sst_pin.SST().compute_torques(home, [0] * 3, [0] * 3))
    typed = Path(module).with_name("py.typed")
    assert typed.is_file()


def test_the_benchmark_tables_are_the_measured_ones():
    """docs/benchmark.json makes them, to the last character."""
    report = load("scripts/benchmark/benchmark_report.py")
    docs = ROOT / "docs"
    results = json.loads((docs / "benchmark.json").read_text(encoding="utf-8"))
    page = (docs / "evidence.md").read_text(encoding="utf-8")
    assert report.table(results) in page
    assert report.with_table(page, results) == page
    assert report.short_table(results) in README
    assert report.with_table(README, results) == README


@pytest.mark.parametrize("code", PYTHON, ids=map(str, range(len(PYTHON))))
def test_python_of_the_readme_runs_and_prints(code, tmp_path, monkeypatch, capsys):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    printed = capsys.readouterr().out
    assert printed
    assert "nan" not in printed
    if "paper_circle" in code:  # the first row is example 1 at t = 0
        first = [float(x) for x in re.findall(r"-?\d+\.\d*", printed.splitlines()[0])]
        assert first == pytest.approx([0, 17.0141, -17.0141], abs=1e-4)


def test_public_names_resolve_and_say_what_they_are():
    """Each once; classes and functions with words of their own."""
    assert len(set(sst_pin.__all__)) == len(sst_pin.__all__)
    assert set(sst_pin.__all__) <= set(dir(sst_pin))
    for name in sst_pin.__all__:
        thing = getattr(sst_pin, name)
        if callable(thing):
            assert thing.__module__.startswith("sst_pin.")
            words = vars(thing)["__doc__"] if isinstance(thing, type) else thing.__doc__
            assert words
            assert not words.startswith(f"{name}(")  # what a dataclass says by itself


def test_a_user_who_imports_the_robots_loads_what_they_need_and_no_more():
    """Counted, not timed: SciPy alone would bring three hundred modules."""
    code = (
        "import sys, pinocchio\n"
        "before = set(sys.modules)\n"
        "from sst_pin import SST, ClosedChain, Parameters, Trajectory, validate\n"
        "print(*sorted(set(sys.modules) - before))\n"
        "import sst_pin.cli.commands\n"
        "print('scipy' in sys.modules)\n"
    )
    loaded, scipy_in_the_command_line = run_python(code).splitlines()
    loaded = loaded.split()
    assert "sst_pin.closed_chain" in loaded
    assert {name.split(".")[0] for name in loaded}.isdisjoint({"scipy", "tqdm", "matplotlib"})
    assert len(loaded) < 250  # 220 measured
    assert scipy_in_the_command_line == "False"


def test_the_core_imports_without_its_extras():
    """matplotlib, meshcat and the engines stay out until they are asked for."""
    code = (
        "import sys\n"
        "for name in 'matplotlib meshcat trimesh mujoco casadi exudyn yourdfpy'.split():\n"
        "    sys.modules[name] = None\n"
        "import sst_pin, sst_pin.cli\n"
        "robot = sst_pin.SST()\n"
        "sst_pin.cli.main(['validate'])\n"
        "sys.exit(sst_pin.cli.main(['paper']))\n"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "[plot]" in result.stderr.partition("-m pip install")[2]


def test_every_file_of_code_names_its_licence():
    for folder in ("sst_pin", "scripts", "tests"):
        for path in (ROOT / folder).rglob("*.py"):
            assert path.read_text().startswith("# SPDX-License-Identifier: BSD-2-Clause\n"), path


@pytest.mark.parametrize("line", ["sst_pin.", "sst_pin.robots.", "robot."])
def test_jedi_completes_a_session(line):
    robot = sst_pin.SST()
    result = jedi.Interpreter(line, [{"sst_pin": sst_pin, "robot": robot}]).complete()
    names = {completion.name for completion in result if completion.name[0] != "_"}
    wanted = {"sst_pin.": set(sst_pin.__all__), "sst_pin.robots.": set(sst_pin.robots.__all__)}
    assert wanted.get(line, {"compute_torques", "home"}) <= names
    if line == "sst_pin.robots.":
        assert names == wanted[line]
