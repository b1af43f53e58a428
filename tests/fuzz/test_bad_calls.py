# SPDX-License-Identifier: BSD-2-Clause
"""Bad calls end with an error that has a name, or with the right answer; never otherwise.

Never raw (another exception than `SSTError`, or the end of the process), silent (a wrong number, or
nothing), endless. Each group of calls runs in a process of its own.
"""

import call_tables
import judged_calls
import pytest


@pytest.mark.parametrize("group", call_tables.GROUPS)
def test_every_bad_call_has_a_named_error_or_a_right_answer(group, record_property):
    """0 raw, 0 silent, 0 endless."""
    verdicts = judged_calls.judged_apart("call_tables", group)
    report = judged_calls.report(verdicts)
    print(f"{group}: {report}")
    record_property("counts", report.splitlines()[0])
    assert not [v for v in verdicts if v.kind in judged_calls.FAULTS], report
