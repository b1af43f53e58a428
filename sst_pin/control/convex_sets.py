# SPDX-License-Identifier: BSD-2-Clause
"""Corners of convex sets."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def hull(points: Array) -> Array:
    """Corners of the convex hull of points, shape (N, k): for k = 2 in order around it.

    The first corner is the first of the points that is one; for k = 1 the least comes first.
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

    # The points p = A_i / b_i are the dual set. A facet n . p = d of its hull, with d > 0, has n .
    # p <= d for all p. So x = n / d keeps all inequalities, with equality for the points of the
    # facet: it is a corner (polarity of convex polytopes).
    dual_points = A / b[:, None]
    if A.shape[1] == 1:
        return 1 / hull(dual_points)
    facets = ConvexHull(dual_points).equations  # rows n, -d
    return hull(-facets[:, :-1] / facets[:, -1:])
