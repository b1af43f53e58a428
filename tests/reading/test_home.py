# SPDX-License-Identifier: BSD-2-Clause
"""The configuration that a description calls home."""

import copy
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.compiled.generator_inputs import sample_configurations
from sst_pin.loops.start import start_of
from sst_pin.reading.mjcf import robot_file_of
from tests.support.files import file_of_page

_SRDF = """<robot name="sst"><group_state name="home" group="all">
{}</group_state></robot>"""


@pytest.fixture
def folder(tmp_path):
    """URDF and cuts of the SST, without its SRDF."""
    for path in (sst_pin.URDF_PATH, sst_pin.sst.YAML_PATH):
        shutil.copy(path, tmp_path)
    return tmp_path


def put_home(folder, **angles):
    lines = [f'<joint name="{name}" value="{value}"/>\n' for name, value in angles.items()]
    (folder / "sst.srdf").write_text(_SRDF.format("".join(lines)))


def read(folder, **options):
    return sst_pin.ClosedChain.from_urdf(folder / "sst.urdf", **options)


def told(folder):
    """The problems that `validate` finds, missing meshes among them."""
    return [str(p) for p in sst_pin.validate(folder / "sst.urdf") if p.where in ("srdf", "home")]


def named(q, digits):
    return dict(zip(sst_pin.SST().joint_names, q.round(digits).tolist(), strict=True))


@pytest.mark.parametrize("reader", ["urdf", "mjcf"])
def test_the_shipped_descriptions_bring_the_home_of_the_closed_form(reader):
    """An SRDF and a keyframe, printed with 15 digits, give the same numbers."""
    file = {"urdf": sst_pin.URDF_PATH, "mjcf": sst_pin.sst.MJCF_PATH}[reader]
    chain = getattr(sst_pin.ClosedChain, f"from_{reader}")(file)
    np.testing.assert_allclose(chain.home, sst_pin.SST().home, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(start_of(chain.engine), chain.home)


def test_a_home_of_a_few_digits_is_closed_with_the_motors_held(folder):
    """Written with two digits the loops are open by some milliradians."""
    expected = sst_pin.SST().home
    put_home(folder, **named(expected, 2))
    chain = read(folder)
    assert np.abs(chain.residual(expected.round(2))).max() > 1e-3
    assert np.abs(chain.residual(chain.home)).max() < 1e-12
    np.testing.assert_array_equal(
        chain.home[chain.motor_indices], expected.round(2)[chain.motor_indices]
    )
    np.testing.assert_allclose(chain.home, expected, rtol=0, atol=0.02)
    (problem,) = told(folder)
    assert problem.startswith("warning: home: the loops are open by 0.00")


def test_a_home_beyond_a_limit_is_told(folder):
    home = named(sst_pin.SST().home, 15)
    put_home(folder, **home)
    assert told(folder) == []
    urdf = (folder / "sst.urdf").read_text()
    joint = re.search(r'<joint name="mu_2".*?</joint>', urdf, re.DOTALL)[0]
    narrow = re.sub(r'upper="[^"]*"', 'upper="0.5"', joint)
    (folder / "sst.urdf").write_text(urdf.replace(joint, narrow))
    (problem,) = told(folder)
    assert re.fullmatch(
        r"warning: home: mu_2 leaves its limits of \S+ to 0\.5 rad: \S+ rad", problem
    )
    assert float(problem.split()[-2]) == pytest.approx(home["mu_2"], abs=1e-3)


def test_a_home_that_cannot_be_closed_is_told_by_its_reader_and_by_validate(folder):
    """The five-bar of docs/own_robot.md: elbows 0.65 m apart, and two rods of 0.3 m."""
    for kind in ("urdf", "yaml"):
        (folder / f"sst.{kind}").write_text(file_of_page("own_robot.md", f"five_bar.{kind}"))
    put_home(folder, left=-1.5708, right=1.5708)
    chain = read(folder)
    with pytest.raises(sst_pin.ClosureError, match="cannot be closed"):
        chain.home  # noqa: B018
    # shown open, as it was written
    assert start_of(chain.engine).tolist() == [-1.5708, 0, 1.5708, 0]
    (problem,) = told(folder)
    assert problem.startswith("warning: home: cannot be closed")


@pytest.mark.filterwarnings("ignore:.*no configuration is named home")
def test_a_robot_without_a_home_says_how_to_give_it_one(folder):
    """Pinocchio's own place for configurations takes it; copies and pickles keep it."""
    chain = read(folder)
    with pytest.raises(sst_pin.DescriptionError, match="home; write group_state home in an SRDF"):
        chain.home  # noqa: B018
    assert np.abs(chain.residual(start_of(chain.engine))).max() < 1e-9
    chain.model.referenceConfigurations["home"] = sst_pin.SST().home
    chain.refresh()
    for same in (chain, copy.copy(chain), pickle.loads(pickle.dumps(chain))):
        np.testing.assert_array_equal(same.home, sst_pin.SST().home)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("<robot", "<srdf", "not XML"),
        ('name="home" ', "", "a group_state has no name"),
        ('value="1"', 'value="1"/><joint name="left_knee" value="2"', "left_knee has two values"),
        ('"left_knee', '"knee', "no joint knee in the URDF"),
        ('value="1"', 'value="0 1"', "left_knee value='0 1' is not a number"),
        ("left_knee", "ball", "ball value='1' is not 4 numbers"),
        ('left_knee" value="1"', 'ball" value="0 0 0 0"', "a rotation in it has no direction"),
        ("left_knee", "cross", "cross is cross_X and cross_Y here"),
        ("left_knee", "weld", "weld is fixed at zero, not at 1"),
    ],
)
def test_a_pose_that_would_lose_a_value_is_refused(folder, old, new, text):
    """`validate` says the same, also where the YAML makes the joint a ball or a universal joint."""
    put_home(folder, left_knee=1)
    write_arm(folder)
    (folder / "sst.srdf").write_text((folder / "sst.srdf").read_text().replace(old, new))
    with pytest.raises(sst_pin.DescriptionError, match=text) as caught:
        read(folder)
    assert "sst.srdf" in str(caught.value)
    (problem,) = caught.value.problems
    assert told(folder) == [f"error: srdf: {problem}"]


@pytest.mark.filterwarnings("ignore::sst_pin.errors.DescriptionWarning")
def test_states_of_several_groups_with_one_name_are_one_pose(folder):
    """MoveIt has such: a joint may be in two groups, and fixed joints stand at zero."""
    put_home(folder, left_knee=1)
    write_arm(folder)
    more = _SRDF.format('<joint name="left_knee" value="1.0"/><joint name="ball" value="0 0 3 4"/>')
    path = folder / "sst.srdf"
    path.write_text(path.read_text().replace("</robot>", more.partition(">")[2]))
    chain = read(folder)
    q = chain.model.referenceConfigurations["home"]
    np.testing.assert_allclose(q, [1, 0, 0, 0.6, 0.8, 0, 0], atol=1e-15)


def write_arm(folder):
    """A hinge, a ball, a universal joint and a weld, in the place of the SST."""
    links = "".join(f'<link name="l{k}"/>' for k in range(5))
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k, name in enumerate(("left_knee", "ball", "cross", "weld"))
    )
    (folder / "sst.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    types = "joint_name: [ball, cross, weld]\njoint_type: [SPHERICAL, UJOINT_XY, FIXED]\n"
    (folder / "sst.yaml").write_text("name_mot: [left_knee]\n" + types)


BARS = """<mujoco><worldbody>
<body name="a"><joint name="crank" axis="0 1 0"/><geom size=".1"/><site name="left" pos="{}"/>
</body><body name="b" pos=".6 0 0"><joint name="rocker" axis="0 1 0" ref="20"/>
<joint name="slide" type="slide" axis="0 0 1"/><geom size=".1"/><site name="right" pos="-.3 0 0"/>
</body></worldbody><equality><connect site1="left" site2="right"/></equality>
<actuator><motor joint="crank"/></actuator>{}</mujoco>"""


@pytest.mark.filterwarnings("ignore:.*home is singular")
@pytest.mark.parametrize(
    ("place", "key", "home"),
    [
        (".3 0 0", "", [0, np.deg2rad(20), 0]),
        (".3 0 0", '<keyframe><key name="high" qpos=".1 0 0"/></keyframe>', [0, np.deg2rad(20), 0]),
        (".3 0 0", '<keyframe><key name="home" qpos="0 .5 0"/></keyframe>', [0, 0.5, 0]),
        (".3001 0 0", "", []),
    ],
)
def test_an_mjcf_without_home_starts_where_it_is_drawn_if_its_loops_are_closed_there(
    tmp_path, place, key, home
):
    """At MuJoCo's `qpos0`."""
    path = Path(tmp_path, "bars.xml")
    path.write_text(BARS.format(place, key))
    poses = sst_pin.ClosedChain.from_mjcf(path).model.referenceConfigurations
    result = {pair.key(): list(pair.data()) for pair in poses}
    assert result.get("home", []) == pytest.approx(home, abs=1e-12)


#: A weld of two arms with a wrong angle of their relative pose, in a robot of any size.
WELDED = """<mujoco><worldbody>
<body name="a"><joint name="crank" axis="0 1 0"/><geom size="{size}"/></body>
<body name="b" pos="{length} 0 0"><joint name="rocker" axis="0 1 0"/><geom size="{size}"/>
<body name="c" pos="0 0 {length}"><joint name="elbow" axis="0 1 0"/><geom size="{size}"/></body>
</body></worldbody><equality>
<weld body1="a" body2="c" relpose="{length} 0 {length} 1 0 {half} 0"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>"""


@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
@pytest.mark.parametrize("length", [0.01, 1.0, 100.0])
@pytest.mark.parametrize(("angle", "is_home"), [(5e-7, True), (5e-6, False)])
def test_the_home_of_an_mjcf_has_closed_angles_in_a_robot_of_any_size(
    tmp_path, length, angle, is_home
):
    """Errors of angles are compared in radians, errors of positions with the robot's length."""
    path = Path(tmp_path, "welded.xml")
    path.write_text(WELDED.format(length=length, size=length / 10, half=angle / 2))
    poses = robot_file_of(path).model.referenceConfigurations
    assert ("home" in [pair.key() for pair in poses]) == is_home


def test_a_generic_configuration_lies_near_home():
    """In either of the two ways to assemble a four-bar; kernels choose their pivots there too."""
    robot = sst_pin.robots.four_bar()
    rest = pin.neutral(robot.model)
    for shift in ([0, 0, 0], [0, -2.5, 0.5]):
        home = robot.assemble(robot.home + shift)
        model = pin.Model(robot.model)
        model.referenceConfigurations["home"] = home
        chain = sst_pin.ClosedChain(model, robot.closures, robot.motor_names)
        kernels = sample_configurations(chain.engine.reference)
        for q in (chain.generic_configuration(), kernels[0]):
            assert 0 < np.abs(q - home).max() < 0.3 < np.abs(q - rest).max()
    assert np.abs(home - robot.home).max() > 1


@pytest.mark.parametrize("home", [np.zeros(2), np.full(3, np.inf)])
def test_a_home_that_is_no_configuration_is_named(home):
    robot = sst_pin.robots.four_bar()
    robot.model.referenceConfigurations["home"] = home
    with pytest.raises(sst_pin.DescriptionError, match=r"home: \d numbers; 3 finite ones"):
        robot.refresh()
