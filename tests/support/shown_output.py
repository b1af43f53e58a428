# SPDX-License-Identifier: BSD-2-Clause
"""Output that a page shows, compared with what is printed now."""

import re

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


def same_output(wanted: str, got: str) -> bool:
    """Equal but for spaces and one unit of each number's last printed place."""
    if "..." in wanted:
        pattern = ".*".join(map(re.escape, " ".join(wanted.split()).split("...")))
        return re.fullmatch(pattern, " ".join(got.split()), re.DOTALL) is not None
    words = [re.sub(r"\s+", "", NUMBER.sub("#", text)) for text in (wanted, got)]
    numbers = [NUMBER.findall(text) for text in (wanted, got)]
    return words[0] == words[1] and all(map(_near, *numbers))


def _near(wanted: str, got: str) -> bool:
    mantissa, _, power = wanted.partition("e")
    places = len(mantissa.partition(".")[2])
    allowed = 1.01 * 10.0 ** (int(power or 0) - places) if "." in mantissa else 0.0
    return abs(float(wanted) - float(got)) <= allowed
