# SPDX-License-Identifier: BSD-2-Clause
"""Compiled extension modules match the sources beside them."""

import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import sst_pin
from sst_pin.errors import CompilationError
from sst_pin.extensions import require_current

PACKAGE = Path(sst_pin.__file__).parent
SOURCES = {
    "compiled._binding": ("compiled/_binding.pyx", "compiled/batches.h"),
    "sst.kernels._plain": ("sst/kernels/kernels.c", "compiled/c/real.h", "compiled/c/driver.h"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_an_extension_of_other_sources_is_refused(tmp_path, name):
    """An updated clone has such extensions; an extension without its sources is loaded."""
    found = find_spec(f"sst_pin.{name}")
    if found is None or found.origin is None or found.origin.endswith(".py"):
        pytest.skip("the extension is not compiled here")
    sources = [tmp_path / Path(source).name for source in SOURCES[name]]
    require_current(found.origin, *sources)
    for source, copy in zip(SOURCES[name], sources, strict=True):
        shutil.copy(PACKAGE / source, copy)
    require_current(found.origin, *sources)
    sources[-1].write_text(sources[-1].read_text() + " ")
    with pytest.raises(CompilationError, match=rf"{sources[0].name}.*pip install -e"):
        require_current(found.origin, *sources)
