# SPDX-License-Identifier: BSD-2-Clause
"""Compiled extension modules match the sources beside them."""

import os
import runpy
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest
import setuptools

import sst_pin
from sst_pin.errors import CompilationError
from sst_pin.extensions import require_current

PACKAGE = Path(sst_pin.__file__).parent
SOURCES = {
    "compiled._binding": ("compiled/_binding.pyx", "compiled/batches.h"),
    "sst.kernels._plain": (
        *("sst/kernels/kernels.c", "sst/kernels/target.h"),
        *("compiled/c/real.h", "compiled/c/driver.h", "sst/kernels/plain.c"),
    ),
}


@pytest.mark.parametrize("name", SOURCES)
def test_an_extension_of_other_sources_is_refused(tmp_path, name):
    """An updated clone has such extensions; it warns. One without its sources is loaded."""
    found = find_spec(f"sst_pin.{name}")
    if found is None or found.origin is None or found.origin.endswith(".py"):
        pytest.skip("the extension is not compiled here")
    sources = [tmp_path / Path(source).name for source in SOURCES[name]]
    require_current(found.origin, *sources)
    for source, copy in zip(SOURCES[name], sources, strict=True):
        shutil.copy(PACKAGE / source, copy)
    require_current(found.origin, *sources)
    sources[-1].write_text(sources[-1].read_text() + " ")
    said = rf"{sources[0].name}.*pip install -e"
    with (
        pytest.warns(RuntimeWarning, match=said),
        pytest.raises(CompilationError, match=said),
    ):
        require_current(found.origin, *sources)


@pytest.fixture
def build(tmp_path, monkeypatch):
    """Builds an extension of one source by setup.py, in an empty folder; its file and its hash."""
    monkeypatch.chdir(PACKAGE.parent)
    monkeypatch.setattr(setuptools, "setup", lambda **_: None)
    setup = runpy.run_path("setup.py")
    monkeypatch.chdir(tmp_path)

    def build(source):
        Path("one.c").write_text(source)
        os.utime("one.c", (0, 0))  # an archive keeps the dates of its files
        name, made_of = setup["made_of"]("one.c")
        made = setuptools.Extension(
            "one", ["one.c"], define_macros=[(name, made_of)], optional=True
        )
        command = setup["BuildOnAllCores"](setuptools.Distribution({"ext_modules": [made]}))
        command.build_lib = command.build_temp = "build"
        command.ensure_finalized()
        command.run()
        (path,) = map(Path, command.get_outputs())
        return path, made_of.strip('"').encode()

    return build


def test_a_second_build_keeps_nothing_of_other_sources_and_all_of_the_same(build):
    source = "const char made_of[] = MADE_OF;"
    path, made_of = build(source)
    first = path.stat()
    assert made_of in path.read_bytes()
    assert build(source)[0].stat() == first
    path, made_of = build(f"{source} ")
    assert made_of in path.read_bytes()
    path, _ = build("no C")
    assert not path.exists()
