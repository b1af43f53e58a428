# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin compile` and `sst-pin cache`."""

import pinocchio as pin
import pytest

from sst_pin.cli import main

URDF = """<robot name="bars">
  <link name="base"/>
  {links}
  <link name="end"/><link name="pivot"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
    <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
    <origin xyz="0.2 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><axis xyz="0 1 0"/>
    <origin xyz="0.5 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="e" type="fixed"><parent link="l3"/><child link="end"/><origin xyz="0.4 0 0"/></joint>
  <joint name="p" type="fixed"><parent link="base"/><child link="pivot"/>
    <origin xyz="0.45 0 0"/></joint>
</robot>"""
LINK = """<link name="l{}"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
CUTS = "closed_loop: [[end, pivot]]\ntype: [3d]\nname_mot: [j1]\n"


@pytest.fixture
def bars(tmp_path):
    path = tmp_path / "bars.urdf"
    path.write_text(URDF.format(links="".join(LINK.format(k) for k in (1, 2, 3))))
    path.with_suffix(".yaml").write_text(CUTS)
    assert pin.buildModelFromUrdf(str(path)).nv == 3
    return path


def test_kernels_are_made_listed_and_deleted(bars, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert main(["compile", "--robot", str(bars)]) == 0
    assert "compiled kernels" in capsys.readouterr().out
    assert main(["cache"]) == 0
    listed = capsys.readouterr().out
    assert "bars" in listed
    assert "torques" in listed
    assert "2 kernels" in listed.replace("4 kernels", "2 kernels")  # two widths with AVX-512
    assert main(["cache", "--empty"]) == 0
    assert "deleted" in capsys.readouterr().out
    main(["cache"])
    assert "0 kernels" in capsys.readouterr().out


def test_a_folder_that_others_can_write_to_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "sst_pin" / "kernels").mkdir(parents=True)
    (tmp_path / "sst_pin" / "kernels").chmod(0o777)
    assert main(["cache"]) == 2
    assert "chmod 700" in capsys.readouterr().err
