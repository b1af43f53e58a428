# SPDX-License-Identifier: BSD-2-Clause
"""Corners of convex sets, against all intersections of their faces."""

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sst_pin.control.convex_sets import corners_of_inequalities, hull


@pytest.mark.parametrize("k", [1, 2, 3])
def test_corners_are_the_intersections_of_faces_that_keep_all_inequalities(k):
    random = np.random.default_rng(k)
    A = random.normal(size=(12, k))
    A = np.vstack([A, -A])  # so that the set is bounded
    b = random.uniform(0.5, 2.0, size=len(A))
    intersections = []
    for rows in combinations(range(len(A)), k):
        if abs(np.linalg.det(A[list(rows)])) > 1e-9:
            x = np.linalg.solve(A[list(rows)], b[list(rows)])
            if (A @ x <= b + 1e-9).all():
                intersections.append(x)
    expected = np.unique(np.round(intersections, 9), axis=0)
    corners = np.unique(np.round(corners_of_inequalities(A, b), 9), axis=0)
    # The corners were rounded to 9 digits.
    assert_allclose(corners, expected, atol=2e-9)


def test_a_hull_in_the_plane_is_in_order_from_the_first_of_its_points():
    points = np.array([[0.0, 0.0], [1, 1], [-1, -1], [-1, 1], [1, -1]])
    corners = hull(points)
    assert_allclose(corners[0], points[1])
    steps = np.roll(corners, -1, axis=0) - corners
    turns = steps[:, 0] * np.roll(steps[:, 1], -1) - steps[:, 1] * np.roll(steps[:, 0], -1)
    assert (turns > 0).all() or (turns < 0).all()
