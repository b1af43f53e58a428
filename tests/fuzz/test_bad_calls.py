# SPDX-License-Identifier: BSD-2-Clause
"""Bad calls end with an error that has a name, or with the right answer; never otherwise.

Never raw (another exception than `SSTError`, or the end of the process), silent (a wrong number, or
nothing), endless. Each group of calls runs in a process of its own. Ducks are not among them: an
object that is no robot at all has not the methods of one. The default run takes each tenth call,
`-m slow` takes them all and prints their counts with `-s`.
"""

import call_tables
import judged_calls
import pytest


@pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("group", call_tables.GROUPS)
def test_bad_calls_have_a_named_error_or_a_right_answer(group, every):
    """0 raw, 0 silent, 0 endless, in all calls or in a tenth of them."""
    verdicts = judged_calls.judged_apart("call_tables", group, every)
    report = judged_calls.report(verdicts)
    print(f"{group}: {report}")
    assert verdicts
    assert not [v for v in verdicts if v.kind in judged_calls.FAULTS], report
