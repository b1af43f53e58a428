# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin` as a function, and calls in a process that lacks a package."""

import subprocess
import sys

from sst_pin.cli import main


def run(capsys, *arguments):
    """Exit code, output, errors."""
    try:
        code = main([str(a) for a in arguments])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, out, err


def said_without(package, call):
    """What the error of a missing extra says when a call on `sst_pin` needs a package."""
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "import sst_pin\n"
        f"try: {call}\n"
        "except sst_pin.errors.MissingExtraError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout
