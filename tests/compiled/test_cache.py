# SPDX-License-Identifier: BSD-2-Clause
"""The cache of kernels where a machine is not as one hopes: it serves, or says what to do."""

import copy
import ctypes
import errno
import logging
import os
import pickle
import pwd
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.compiled import build
from sst_pin.errors import CompilationError
from tests.support import link_tables
from tests.support.by_hand import add, at, mark
from tests.support.command_line import BARS

SOURCE = "int answer(void) { return 42; }"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "sst_pin" / "kernels"


def answer():
    """Messages about a library that is compiled, or found in the cache."""
    return build.library("robot", "kernel", b"content", "plain", lambda: SOURCE).answer()


def another_process():
    """From now on nothing is loaded."""
    build._loaded.clear()


def raising(error):
    def function(*_, **__):
        raise error

    return function


def test_a_log_says_what_is_compiled_and_nothing_where_the_cache_has_it(folder, caplog):
    caplog.set_level("INFO", logger="sst_pin")
    assert answer() == answer() == 42
    assert caplog.messages == ["compiling kernel of robot for plain; the cache keeps it"]


def test_a_library_that_is_damaged_is_made_anew(folder):
    assert answer() == 42
    (entry,) = build.cached()
    damaged = entry.path.read_bytes()[:-100]
    entry.path.unlink()  # what is loaded stays
    entry.path.write_bytes(damaged)
    another_process()
    assert answer() == 42
    (again,) = build.cached()
    assert again.path.name.split(".")[-2] == build._digest(again.path)


def test_a_cache_that_cannot_be_written_serves_what_is_in_it(folder, monkeypatch):
    assert answer() == 42
    another_process()
    monkeypatch.setattr(os, "utime", raising(PermissionError(errno.EROFS, "Read-only")))
    monkeypatch.setattr(build, "_compile", raising(AssertionError("it is in the cache")))
    assert answer() == 42


@pytest.mark.parametrize(
    ("place", "name", "said"),
    [
        (tempfile, "TemporaryDirectory", "No space left on device"),
        (os, "replace", "Read-only file system"),
        (ctypes, "CDLL", "failed to map segment from shared object"),
    ],
)
def test_a_folder_that_does_not_do_is_named_with_the_cure(folder, monkeypatch, place, name, said):
    """A full disk, a place that turned read-only, one from which nothing may be run."""
    if name == "replace":  # what Path.replace calls
        monkeypatch.setattr("pathlib.os.replace", raising(OSError(errno.EROFS, said)))
    elif name == "CDLL":
        monkeypatch.setattr(place, name, raising(OSError(said)))
    else:
        monkeypatch.setattr(place, name, raising(OSError(errno.ENOSPC, said)))
    with pytest.raises(
        CompilationError, match=f"{folder} cannot be used: {said}; set XDG_CACHE_HOME"
    ):
        answer()


def test_files_of_others_in_the_folder_are_no_entries(folder):
    assert answer() == 42
    (folder / "notes.so").touch()
    (folder / "readme").touch()
    assert [(e.robot, e.kernel) for e in build.cached()] == [("robot", "kernel")]
    assert build.empty_cache() == 1
    assert sorted(path.name for path in folder.iterdir()) == ["notes.so", "readme"]


def test_a_user_without_a_home_is_told_where_to_name_one(monkeypatch):
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # which does not count
    monkeypatch.setattr(pwd, "getpwuid", raising(KeyError("no such user")))
    with pytest.raises(CompilationError, match=r"no place for a cache.*XDG_CACHE_HOME"):
        answer()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"not a program", "cc cannot be run: Exec format error"),
        (
            b"#!/bin/sh\nprintf 'an \\377 odd byte' >&2; exit 1\n",
            "failed with code 1:\nan . odd byte",
        ),
        (b"#!/bin/sh\nkill -9 $$\n", "failed with code -9"),
        (b"#!/bin/sh\nexit 0\n", "failed with code 0:\nit wrote no library; set CC to another"),
        (
            b'#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done; echo no library > "$2"\n',
            "kernel.so: .*; set XDG_CACHE_HOME to another folder, or CC to another compiler",
        ),
    ],
)
def test_whatever_a_compiler_does_is_told(folder, tmp_path, monkeypatch, content, said):
    fake = tmp_path / "cc"
    fake.write_bytes(content)
    fake.chmod(0o755)
    monkeypatch.setenv("CC", str(fake))
    with pytest.raises(CompilationError, match=said):
        answer()
    assert not list(folder.iterdir())
    monkeypatch.delenv("CC")
    assert answer() == 42  # nothing of the failure is kept


def test_a_compiler_that_is_not_there_is_named_and_none_is_the_system_s(folder, monkeypatch):
    monkeypatch.setenv("CC", "nonsense-cc -m64")
    with pytest.raises(CompilationError, match="CC names nonsense-cc, which is not found"):
        answer()
    monkeypatch.setenv("CC", " ")
    assert answer() == 42


def test_names_of_any_length_and_script_fit_into_the_cache(folder):
    label = "\N{CJK UNIFIED IDEOGRAPH-673A}" * 100
    made = build.library(label, label, b"content", "plain", lambda: SOURCE)
    assert made.answer() == 42
    assert [len(entry.robot) for entry in build.cached()] == [40 // 3]


@pytest.fixture
def version():
    """What all libraries depend on, computed anew."""
    yield build._version.__wrapped__
    build._version.cache_clear()


def test_machines_that_share_a_home_do_not_share_libraries(folder, monkeypatch, version):
    assert answer() == 42
    another = os.uname_result(("Linux", "node", "6", "1", "another machine"))
    monkeypatch.setattr(os, "uname", lambda: another)
    build._version.cache_clear()
    assert answer() == 42
    assert len(build.cached()) == 2


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
def test_robots_that_differ_in_what_a_name_means_have_their_own_kernels(folder, case):
    *orders, closures, forces, motors = NAMED[case]
    for names in orders:
        model = pin.Model()
        for i, name in enumerate(names):
            body = pin.Inertia(1.0 + i, np.array([0.1 * (i + 1), 0, 0.05]), np.eye(3))
            joint = add(model, 0, pin.JointModelRY(), name, at(0.3 * i), body)
            mark(model, joint, f"{name} end", at(0, 0, 0.2))
        driven = [name for name in names if name in motors]
        chain = sst_pin.ClosedChain(model, closures, driven, forces=forces)
        q, (va, aa) = np.zeros(3), np.random.default_rng(0).standard_normal((2, len(motors)))
        expected = chain.compute_torques(q, va, aa)
        chain.compile(q)
        assert "by the reference" not in chain.path
        np.testing.assert_allclose(chain.compute_torques(q, va, aa), expected, atol=1e-12)


def test_what_a_killed_process_left_goes_with_the_cache_but_not_what_is_being_made(folder):
    assert answer() == 42
    for name, age in (("old", 2 * 86_400), ("new", 0)):
        left = folder / f".building-{name}"
        left.mkdir()
        (left / "kernel.c").touch()
        os.utime(left, (time.time() - age,) * 2)
    build.empty_cache()
    assert [path.name for path in folder.iterdir()] == [".building-new"]


def test_a_library_that_another_process_deletes_while_it_is_loaded_is_made_again(
    folder, monkeypatch
):
    assert answer() == 42
    another_process()
    (entry,) = build.cached()  # under another name, because the loader knows the file
    other = entry.path.rename(folder / f"another_{entry.path.name}")
    touch = os.utime
    monkeypatch.setattr(os, "utime", lambda path: (touch(path), path.unlink()))
    assert answer() == 42
    assert [again.path for again in build.cached()] == [entry.path]
    assert not other.exists()


def test_the_cache_stays_below_its_bound_and_loses_what_was_used_longest_ago(folder, monkeypatch):
    def made(k):
        source = f"int answer(void) {{ return {k}; }}"
        return build.library(f"robot{k}", "kernel", bytes([k]), "plain", lambda: source)

    loaded = {0: made(0)}
    (entry,) = build.cached()
    monkeypatch.setattr(build, "LARGEST", 3 * entry.size + entry.size // 2)
    for k in (1, 2):
        loaded[k] = made(k)
    for k, age in ((0, 30), (1, 20), (2, 10)):
        (path,) = folder.glob(f"robot{k}.*")
        os.utime(path, (time.time() - age,) * 2)
    another_process()
    made(0)  # used again
    loaded[3] = made(3)
    assert {entry.robot for entry in build.cached()} == {"robot0", "robot2", "robot3"}
    assert [library.answer() for library in loaded.values()] == [0, 1, 2, 3]  # in memory


def test_a_robot_searches_the_cache_for_each_kernel_once(monkeypatch):
    chain, asked, library = link_tables.four_bar().chain(), [], build.library
    q = chain.generic_configuration()
    chain.compile(q)

    def counting(robot, kernel, content, target, *rest):
        asked.append((kernel, target))
        return library(robot, kernel, content, target, *rest)

    monkeypatch.setattr(build, "library", counting)
    for width in (1e-3, 2e-3, 3e-3):
        chain.torque_derivatives(q, [1.0], [0.0], sign_width=width)
        chain.rollout(np.zeros((3, 1)), q, [1.0], 1e-3, sign_width=width)
    assert {"torque_derivatives", "rollout"} <= {kernel for kernel, _ in asked}
    assert len(asked) == len(set(asked))


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    chain = sst_pin.robots.four_bar()
    chain.compile(all=True)
    caplog.set_level(logging.INFO, logger="sst_pin")
    caplog.clear()
    q, zero = chain.home, np.zeros(1)
    for wrench in (None, np.zeros((chain.model.njoints - 1, 6))):
        load = {} if wrench is None else {"external_wrenches": wrench}
        tau = chain.compute_torques(q, zero, zero, **load)
        chain.generalized_forces(q, zero, zero, **load)
        chain.compute_accelerations(q, zero, tau, **load)
        chain.torque_derivatives(q, zero, zero, **load)
        chain.acceleration_derivatives(q, zero, tau, **load)
        chain.linearize(q, zero, tau, **load)
        chain.rollout(np.zeros((3, 1)), q, zero, 1e-3, **load)
        chain.simulate(tau, q, zero, np.linspace(0, 0.01, 3), **load)
    chain.joint_rates(q, zero)
    chain.joint_accelerations(q, zero, zero)
    chain.reduced_terms(q, zero)
    assert [record.getMessage() for record in caplog.records] == []


def kernel_of(robot, k, seconds, clock=None):
    """A kernel that takes some time to be made."""
    source, content = "int zero(void) { return 0; }", bytes([k])
    build.library(
        robot, "kernel", content, "plain_one", lambda: time.sleep(seconds) or source, (), clock
    )


def test_a_person_who_waits_longer_than_a_second_is_told_once_by_each_call(folder, caplog):
    """A call may make several kernels, each quick, side by side or one after the other."""
    with ThreadPoolExecutor() as pool:
        for robot, seconds in (("quick", 0.0), ("bars", 0.6), ("bars", 1.2)):
            clock, k = build.Clock(robot), len(build.cached())
            list(pool.map(kernel_of, [robot] * 3, range(k, k + 3), [seconds] * 3, [clock] * 3))
            kernel_of(robot, k + 3, seconds, clock)
    kernel_of("bars", 90, 1.2)
    told = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert told == ["sst-pin: compiling kernels of bars; the cache keeps them"] * 3


def test_a_process_loads_a_library_once(monkeypatch):
    """Robots that are changed, copied, unpickled search no cache and read no file."""
    chain = sst_pin.robots.five_bar()
    q, zero = chain.home, np.zeros(2)
    chain.compile()
    monkeypatch.setattr(build, "_found", raising(AssertionError("it is loaded")))
    chain.model.inertias[1].mass *= 1.1
    chain.refresh()
    others = copy.deepcopy(chain), pickle.loads(pickle.dumps(chain))
    for one in (chain, *others, chain.with_parameters(chain.dynamic_parameters)):
        one.compute_torques(q, zero, zero)
        assert one.path.startswith("compiled kernels")


def test_kernels_are_made_listed_and_deleted(tmp_path, monkeypatch, capsys):
    bars = tmp_path / "bars.xml"
    bars.write_text(BARS)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert main(["compile", "--robot", str(bars)]) == 0
    assert "compiled kernels" in capsys.readouterr().out
    assert main(["compile", "--list"]) == 0
    listed = capsys.readouterr().out
    assert "bars" in listed
    assert "torques" in listed
    assert "2 kernels" in listed.replace("4 kernels", "2 kernels")  # two widths with AVX-512
    assert main(["compile", "--clear"]) == 0
    assert "deleted" in capsys.readouterr().out
    main(["compile", "--list"])
    assert "0 kernels" in capsys.readouterr().out


def test_a_folder_that_others_can_write_to_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "sst_pin" / "kernels").mkdir(parents=True)
    (tmp_path / "sst_pin" / "kernels").chmod(0o777)
    assert main(["compile", "--list"]) == 2
    assert "chmod 700" in capsys.readouterr().err
