# SPDX-License-Identifier: BSD-2-Clause
"""Short texts for people."""

import pytest

from sst_pin.summaries import three_digits


@pytest.mark.parametrize(
    ("value", "text"),
    [(23912.0, "23900"), (-1.2345e6, "-1230000"), (16.93, "16.9"), (2.0, "2"), (1e-7, "1e-07")],
)
def test_three_digits_have_no_power_of_ten_where_people_write_none(value, text):
    assert three_digits(value) == text
