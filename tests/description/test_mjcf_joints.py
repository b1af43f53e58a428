# SPDX-License-Identifier: BSD-2-Clause
"""Principal axes of bodies in an MJCF."""

import numpy as np
from scipy.spatial.transform import Rotation

from sst_pin.description.mjcf_joints import principal_axes


def test_principal_axes_are_a_rotation_by_less_than_a_right_angle():
    for R in Rotation.random(500, random_state=1).as_matrix():
        inertia = R @ np.diag([1.0, 2.0, 4.0]) @ R.T
        moments, axes = principal_axes(inertia)
        # Eigenvalues of a symmetric matrix with the norm 4 are exact to a few roundings.
        np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-14)
        np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-14)
        assert np.trace(axes) > 1
