# SPDX-License-Identifier: BSD-2-Clause
"""Corners of convex sets."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def hull(points: Array) -> Array:
    """Corners of the convex hull of points, shape (N, k): for k = 2 in order around it.

    The first corner is the one that comes first among the points; for k = 1 it is the least one.
    """
    from scipy.spatial import ConvexHull

    if points.shape[1] == 0:
        return points[:1]
    if points.shape[1] == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    around = ConvexHull(points).vertices
    return np.asarray(points[np.roll(around, -int(around.argmin()))])


def corners_of_inequalities(A: Array, b: Array) -> Array:
    """Corners of the bounded set of all x for which A x <= b, in the order of `hull`.

    Args:
        A: Shape (rows, k), k >= 1, of rank k.
        b: Positive, shape (rows,), so that x = 0 is inside.
    """
    from scipy.spatial import ConvexHull

    # With the dual points p_i = A_i / b_i, the inequalities are p_i . x <= 1. Each facet of the
    # hull of the dual points has a normal n and a distance d > 0 from the origin: n . p = d for the
    # points of the facet, and n . p <= d for all points. So x = n / d satisfies all inequalities,
    # those of the facet with equality: x is a corner (polarity of convex polytopes).
    dual_points = A / b[:, None]
    if A.shape[1] == 1:
        return 1 / hull(dual_points)  # facets are the least and the largest dual point
    equations = ConvexHull(dual_points).equations  # each row is [n, -d]
    n = equations[:, :-1]
    d = -equations[:, -1:]
    return hull(n / d)
