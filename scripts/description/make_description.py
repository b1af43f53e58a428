# SPDX-License-Identifier: BSD-2-Clause
"""Write urdf/ from the paper's parameters; --check only compares."""

import argparse
import io
import re
import sys
from pathlib import Path

import numpy as np

from sst_pin import Parameters
from sst_pin.description.folder import description_writers
from sst_pin.files import write_files
from sst_pin.sst.robot_wrapper import configurations_of

FOLDER = Path(__file__).resolve().parents[2] / "urdf"
#: The last bits of a sine are the machine's own, and STL has seven digits.
_TOLERANCE = 1e-6


def same(path: Path, content: bytes) -> bool:
    """Whether a file is there and holds the same, its meshes to a micrometre."""
    if not path.is_file():
        return False
    found = path.read_bytes()
    if path.suffix == ".stl":
        return len(found) == len(content) and np.allclose(
            *(_corners(stl) for stl in (found, content)), rtol=0, atol=_TOLERANCE
        )
    if path.suffix == ".obj":
        (words, numbers), (words_now, numbers_now) = (_words(obj) for obj in (found, content))
        return words == words_now and np.allclose(numbers, numbers_now, rtol=0, atol=_TOLERANCE)
    return found == content


def _corners(stl: bytes) -> np.ndarray:
    """The corners of all triangles of a binary STL, shape (faces, 3, 3)."""
    triangle = np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")])
    return np.frombuffer(stl[84:], triangle)["corners"].reshape(-1, 3, 3)


def _words(obj: bytes) -> tuple[str, np.ndarray]:
    """The text of an OBJ without its decimal numbers, and these."""
    text = obj.decode()
    decimal = r"-?\d+\.\d+"
    return re.sub(decimal, "", text), np.array(re.findall(decimal, text), dtype=float)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="exit 1 when a file is not current")
    check = parser.parse_args().check
    writers = description_writers(Parameters(), configurations_of(Parameters()))
    if not check:
        write_files({FOLDER / name: writer for name, writer in writers.items()}, force=True)
        return 0
    stale = []
    for name, write in writers.items():
        content = io.BytesIO()
        write(content)
        if not same(FOLDER / name, content.getvalue()):
            stale.append(name)
    if stale:
        print(
            f"not current: {', '.join(stale)}; run scripts/description/make_description.py",
            file=sys.stderr,
        )
    return bool(stale)


if __name__ == "__main__":
    raise SystemExit(main())
