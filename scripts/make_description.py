# SPDX-License-Identifier: BSD-2-Clause
"""Write urdf/sst.urdf and urdf/sst.yaml from the paper's parameters; --check only compares."""

import argparse
import sys
from pathlib import Path

from sst_pin import Parameters
from sst_pin.description import cuts_of, urdf_of

FOLDER = Path(__file__).resolve().parents[1] / "urdf"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="exit 1 when a file is not current")
    check = parser.parse_args().check
    parameters = Parameters()
    stale = []
    for name, text in (("sst.urdf", urdf_of(parameters)), ("sst.yaml", cuts_of(parameters))):
        path = FOLDER / name
        if check:
            if not path.is_file() or path.read_text(encoding="utf-8") != text:
                stale.append(name)
        else:
            path.write_text(text, encoding="utf-8")
    if stale:
        print(f"not current: {', '.join(stale)}; run scripts/make_description.py", file=sys.stderr)
    return bool(stale)


if __name__ == "__main__":
    raise SystemExit(main())
