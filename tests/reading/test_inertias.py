# SPDX-License-Identifier: BSD-2-Clause
"""Inertias that no body has are read with a warning: robots of makers have them."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.reading.inertia_checks import impossible

TEXT = Path(sst_pin.URDF_PATH).read_text(encoding="utf-8")
_INERTIA = r'(<link name="link_2">.*?<mass value=")[^"]*(" />\s*<inertia )[^/]*/>'


def with_inertia(folder, mass, xx, yy, zz):
    """The SST with other numbers in one link."""
    numbers = f'ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"'
    text, count = re.subn(_INERTIA, rf"\g<1>{mass}\g<2>{numbers}/>", TEXT, count=1, flags=re.S)
    assert count == 1
    path = folder / "sst.urdf"
    path.write_text(text, encoding="utf-8")
    (folder / "sst.yaml").write_text(Path(sst_pin.sst.YAML_PATH).read_text(encoding="utf-8"))
    return path


@pytest.mark.parametrize(
    ("kind", "numbers", "told"),
    [
        (sst_pin.ClosedChain, (1, 1e-3, 2e-3, 4e-3), "link link_2: impossible inertia"),
        (sst_pin.ClosedChain, (1, -1e-3, 2e-3, 2e-3), "link link_2: inertia not positive definite"),
        (sst_pin.SST, (0, 1e-3, 1e-3, 1e-3), "link link_2: inertia without mass"),
    ],
)
def test_a_warning_points_to_the_caller_and_the_numbers_are_computed_with(
    tmp_path, kind, numbers, told
):
    path = with_inertia(tmp_path, *numbers)
    with pytest.warns(sst_pin.DescriptionWarning, match=told) as caught:
        chain = kind.from_urdf(path)
    assert [warning.filename for warning in caught] == [__file__]
    body = chain.model.inertias[chain.model.getJointId("gamma_2")]
    np.testing.assert_allclose(np.linalg.eigvalsh(body.inertia), numbers[1:], rtol=1e-9)
    assert any(f"warning: {told}" in str(problem) for problem in sst_pin.validate(path))


@pytest.mark.parametrize("numbers", [(1, 0, 0, 0), (1, 0, 2e-3, 2e-3), (1, 1e-3, 2e-3, 3e-3)])
def test_points_rods_and_discs_are_bodies(tmp_path, numbers):
    with warnings.catch_warnings():
        warnings.simplefilter("error", sst_pin.DescriptionWarning)
        sst_pin.ClosedChain.from_urdf(with_inertia(tmp_path, *numbers))


def test_what_points_with_mass_have_is_possible_and_no_more():
    """Their moments by definition; with the least second moment below 0 no body has them."""
    random = np.random.default_rng(0)
    for size in np.repeat([1e-6, 1.0, 1e6], 50):
        points = size * random.normal(size=(random.integers(1, 6), 3))
        second = points.T @ points
        assert impossible(1.0, np.trace(second) * np.eye(3) - second) == ""
        moments, axes = np.linalg.eigh(second)
        less = axes @ np.diag(moments - [0.01 * moments[2] + moments[0], 0, 0]) @ axes.T
        assert impossible(1.0, np.trace(less) * np.eye(3) - less)
