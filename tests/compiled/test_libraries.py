# SPDX-License-Identifier: BSD-2-Clause
"""The cache of kernels where a machine is not as one hopes: it serves, or says what to do."""

import copy
import errno
import os
import pickle
import re
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.compiled import c_code, libraries
from sst_pin.compiled.generator_inputs import fingerprint
from sst_pin.compiled.symbolic_parameters import SymbolicParameters
from sst_pin.errors import CompilationError
from tests.support.by_hand import add, at, mark

SOURCE = "int answer(void) { return 42; }"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "sst_pin" / "kernels"


def answer():
    """Messages about a library that is compiled, or found in the cache."""
    return libraries.load("robot", "kernel", b"content", "plain", lambda: [SOURCE]).answer()


def another_process():
    """From now on nothing is loaded."""
    libraries._loaded.clear()


def raising(error):
    def function(*_, **__):
        raise error

    return function


def test_a_person_is_told_once_in_a_process_and_a_log_of_all_that_is_compiled(folder, caplog):
    """Of a robot with two kernels, and of one whose kernel the cache has at the second call."""
    caplog.set_level("INFO", logger="sst_pin")
    libraries._announce_once.cache_clear()
    for robot, kernel in (("bars", "a"), ("bars", "b"), ("quick", "a"), ("quick", "a")):
        libraries.load(robot, kernel, b"content", "plain", lambda: [SOURCE])
        another_process()
    assert [(record.levelname, record.getMessage()) for record in caplog.records] == [
        ("WARNING", "sst-pin: compiling kernels of bars; the cache keeps them"),
        ("INFO", "compiling a of bars for plain; the cache keeps it"),
        ("INFO", "compiling b of bars for plain; the cache keeps it"),
        ("WARNING", "sst-pin: compiling kernels of quick; the cache keeps them"),
        ("INFO", "compiling a of quick for plain; the cache keeps it"),
    ]


@pytest.mark.parametrize(
    ("function", "number", "said"),
    [
        ("shutil.copyfile", [errno.ENOSPC], "No space left on device"),
        ("os.replace", [errno.EROFS], "Read-only file system"),
        ("ctypes.CDLL", [], "failed to map segment from shared object"),
    ],
)
def test_a_folder_that_does_not_do_is_named_with_the_cure(
    folder, monkeypatch, function, number, said
):
    """A full disk, a place that turned read-only, one from which nothing may be run."""
    monkeypatch.setattr(function, raising(OSError(*number, said)))
    with pytest.raises(
        CompilationError, match=f"{folder} cannot be used: {said}; set XDG_CACHE_HOME"
    ):
        answer()


@pytest.fixture
def version():
    """What all libraries depend on, computed anew."""
    yield libraries._version.__wrapped__
    libraries._version.cache_clear()


def test_machines_that_share_a_home_do_not_share_libraries(folder, monkeypatch, version):
    assert answer() == 42
    another = os.uname_result(("Linux", "node", "6", "1", "another machine"))
    monkeypatch.setattr(os, "uname", lambda: another)
    libraries._version.cache_clear()
    assert answer() == 42
    assert len(libraries.cached()) == 2


@pytest.mark.parametrize(
    "changed", ["model/thresholds.py", "dynamics/reactions.py", "compiled/c/driver.h", "version.py"]
)
def test_libraries_of_other_code_are_not_used(monkeypatch, version, changed):
    """All that ends in the C counts: a tolerance of the chain is a constant there."""
    before, read = version(), Path.read_bytes

    def edited(path):
        return read(path) + b" " * path.as_posix().endswith(f"sst_pin/{changed}")

    monkeypatch.setattr(Path, "read_bytes", edited)
    assert version() != before


#: Names of three shafts in two orders that look alike but for what the names mean, and who means.
NAMED = {
    "coupling": ("abc", "acb", [sst_pin.Coupling("a", {"b": [0, 2.0], "c": [0, 3.0]})], [], "bc"),
    "rod": ("abc", "cba", [sst_pin.Distance("a end", "b end", 0.3)], [], "ac"),
    "line": ("abc", "bac", [], [sst_pin.LineForce("universe", "b end", stiffness=50.0)], "abc"),
}


@pytest.mark.parametrize("case", NAMED)
def test_robots_that_differ_in_what_a_name_means_have_their_own_kernels(case):
    *orders, closures, forces, motors = NAMED[case]
    contents = set()
    for names in orders:
        model = pin.Model()
        for i, name in enumerate(names):
            body = pin.Inertia(1.0 + i, np.array([0.1 * (i + 1), 0, 0.05]), np.eye(3))
            joint = add(model, 0, pin.JointModelRY(), name, at(0.3 * i), body)
            mark(model, joint, f"{name} end", at(0, 0, 0.2))
        driven = [name for name in names if name in motors]
        chain = sst_pin.ClosedChain(model, closures, driven, lines=forces)
        contents.add(fingerprint(chain.mechanism, SymbolicParameters(chain.mechanism), np.zeros(3)))
    assert len(contents) == 2


def test_the_cache_stays_below_its_bound_and_loses_what_was_used_longest_ago(folder, monkeypatch):
    def made(k):
        source = f"int answer(void) {{ return {k}; }}"
        return libraries.load(f"robot{k}", "kernel", bytes([k]), "plain", lambda: [source])

    loaded = {0: made(0)}
    (entry,) = libraries.cached()
    monkeypatch.setattr(libraries, "LARGEST", 3 * entry.size + entry.size // 2)
    for k in (1, 2):
        loaded[k] = made(k)
    for k, age in ((0, 30), (1, 20), (2, 10)):
        (path,) = folder.glob(f"robot{k}.*")
        os.utime(path, (time.time() - age,) * 2)
    another_process()
    made(0)  # used again
    loaded[3] = made(3)
    assert {entry.robot for entry in libraries.cached()} == {"robot0", "robot2", "robot3"}
    assert [library.answer() for library in loaded.values()] == [0, 1, 2, 3]  # in memory


def test_a_process_loads_a_library_once(monkeypatch):
    """Robots that are changed, copied, unpickled search no cache and read no file."""
    chain = sst_pin.robots.five_bar()
    q, zero = chain.home, np.zeros(2)
    chain.compile()
    monkeypatch.setattr(libraries, "_from_cache", raising(AssertionError("it is loaded")))
    chain.model.inertias[1].mass *= 1.1
    chain.refresh()
    others = copy.deepcopy(chain), pickle.loads(pickle.dumps(chain))
    for one in (chain, *others, chain.with_parameters(chain.dynamic_parameters)):
        one.compute_torques(q, zero, zero)
        assert one.backend.startswith("compiled kernels")


def test_kernels_are_made_listed_and_deleted(tmp_path, monkeypatch, capsys):
    assert main(["compile", "--robot", "five_bar"]) == 0
    assert "compiled kernels" in capsys.readouterr().out
    assert main(["compile", "--list"]) == 0
    assert re.search(r"^five_bar +torques +\d+ kB", capsys.readouterr().out, re.MULTILINE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert answer() == 42
    assert main(["compile", "--list"]) == 0
    assert "1 kernels" in capsys.readouterr().out
    assert main(["compile", "--clear"]) == 0
    assert "1 kernels deleted" in capsys.readouterr().out
    main(["compile", "--list"])
    assert "0 kernels" in capsys.readouterr().out


def test_a_folder_that_others_can_write_to_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "sst_pin" / "kernels").mkdir(parents=True)
    (tmp_path / "sst_pin" / "kernels").chmod(0o777)
    assert main(["compile", "--list"]) == 2
    assert "chmod 700" in capsys.readouterr().err


def test_single_samples_and_batches_are_compiled_from_the_same_source(folder, monkeypatch):
    keys = []
    generate = c_code.library

    def counted(entry, *arguments):
        keys.append(entry)
        return generate(entry, *arguments)

    monkeypatch.setattr(c_code, "library", counted)
    sst_pin.robots.four_bar().compile()
    assert sorted(keys) == ["accelerations", "torques"]
    assert len(list(folder.glob("*.so"))) == 2 * len(keys)
