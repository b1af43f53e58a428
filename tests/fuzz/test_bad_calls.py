# SPDX-License-Identifier: BSD-2-Clause
"""Bad calls end with an error that has a name, or with the right answer; never otherwise.

Never raw (another exception than `SSTError`, or the end of the process), silent (a wrong number, or
nothing), endless. Each group of calls runs in a process of its own. Ducks are not among them: an
object that is no robot at all has not the methods of one. The default run takes each 59th call of
most groups, `-m slow` takes all calls and prints their counts with `-s`.
"""

import pytest

from tests.fuzz import file_calls, judged_calls, signature_calls, special_calls
from tests.fuzz.call_world import World

GROUPS = {
    "signatures": signature_calls.calls,
    "chains": special_calls.chains,
    "motions": special_calls.motions,
    "files": file_calls.calls,
    "pictures": special_calls.pictures,
}


def calls(group):
    """The calls of one group, for the process that judges them."""
    return GROUPS[group](World())


@pytest.mark.parametrize(
    ("group", "every"),
    [
        *((group, 59) for group in GROUPS if group != "pictures"),
        *(pytest.param(group, 1, marks=pytest.mark.slow) for group in GROUPS),
    ],
)
def test_bad_calls_have_a_named_error_or_a_right_answer(group, every):
    """0 raw, 0 silent, 0 endless, in all calls or in some of them."""
    verdicts = judged_calls.judged_apart("tests.fuzz.test_bad_calls", group, every)
    report = judged_calls.report(verdicts)
    print(f"{group}: {report}")
    assert verdicts
    assert not [v for v in verdicts if v.kind in judged_calls.FAULTS], report
