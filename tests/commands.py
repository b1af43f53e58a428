# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin` as a function."""

from sst_pin.cli import main


def run(capsys, *arguments):
    """Exit code, output, errors."""
    try:
        code = main([str(a) for a in arguments])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, out, err
