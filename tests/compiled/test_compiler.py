# SPDX-License-Identifier: BSD-2-Clause
"""Whatever a compiler does is told, with the cure."""

import threading

import pytest

from sst_pin.compiled import compiler, libraries
from sst_pin.errors import CompilationError


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "sst_pin" / "kernels"


def answer():
    return libraries.load(
        "robot", "kernel", b"content", "plain", lambda: ["int answer(void) { return 42; }"]
    ).answer()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"not a program", "cc cannot be run: Exec format error"),
        (
            b"#!/bin/sh\nprintf 'an \\377 odd byte' >&2; exit 1\n",
            "failed with code 1:\nan . odd byte",
        ),
        (b"#!/bin/sh\nkill -9 $$\n", "failed with code -9"),
        (b"#!/bin/sh\nexit 0\n", "cc wrote no file; set CC to another compiler"),
        (
            b'#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done; echo no library > "$2"\n',
            "too short; set XDG_CACHE_HOME to another folder, or CC to another compiler",
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


def test_a_long_source_compiles_without_the_options_that_a_compiler_does_not_know(
    folder, tmp_path, monkeypatch
):
    fake, calls = tmp_path / "cc", tmp_path / "calls"
    fake.write_text(
        f'#!/bin/sh\necho "$*" >> {calls}\n'
        'case "$*" in *-fno-dse*) echo "unknown option" >&2; exit 1;; esac\nexec cc "$@"\n'
    )
    fake.chmod(0o755)
    monkeypatch.setenv("CC", str(fake))
    monkeypatch.setattr(compiler, "_LONG_SOURCE", 10)
    assert answer() == 42
    asked, compiled, linked = calls.read_text().splitlines()
    assert "-fno-dse" in asked
    assert "-O2" in compiled
    assert "-shared" in linked


def test_as_many_sources_compile_at_once_as_there_are_processors(tmp_path, monkeypatch):
    """On 40 processors all of 40 sources meet; a barrier that misses one breaks."""
    together = threading.Barrier(40, timeout=1)

    def run(arguments, result):
        if "-c" in arguments:
            together.wait()

    monkeypatch.setattr(compiler, "_PROCESSORS", 40)
    monkeypatch.setattr(compiler, "_PROCESSES", threading.BoundedSemaphore(40))
    monkeypatch.setattr(compiler, "_run", run)
    compiler.compile_library([""] * 40, tmp_path / "robot.so", ())
