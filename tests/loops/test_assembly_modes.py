# SPDX-License-Identifier: BSD-2-Clause
"""All assembly modes, against poses of the literature and closed forms."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import robots
from tests.support.by_hand import add, at, mark
from tests.support.planar_bars import DRAG_LINK, planar

#: P. Dietmaier, The Stewart-Gough platform of general geometry can have 40 real postures, 1998, in
#: the numbers of the documentation of CuikSuite.
BASE = [
    (0, 0, 0),
    (1.107915, 0, 0),
    (0.549094, 0.756063, 0),
    (0.735077, -0.223935, 0.525991),
    (0.514188, -0.526063, -0.368418),
    (0.590473, 0.094733, -0.205018),
]
PLATFORM = [
    (0, 0, 0),
    (0.542805, 0, 0),
    (0.956919, -0.528915, 0),
    (0.665885, -0.353482, 1.402538),
    (0.478359, 1.158742, 0.107672),
    (-0.137087, -0.235121, 0.353913),
]
LEGS = [1, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071]
#: A planar 3-RPR: points of the base and of the platform, lengths of the legs, and all poses (x, y
#: of the first point of the platform, angle), found by elimination and bisection.
RPR_BASE = [(0, 0), (15.91, 0), (0, 10)]
RPR_PLATFORM = [(0, 0), (17.04, 0), (20.84 * np.cos(0.882603), 20.84 * np.sin(0.882603))]
RPR_LEGS = [14.98, 15.38, 12]
RPR_POSES = [
    (-8.726595049, 12.175669955, -0.986974258),
    (-5.495663444, -13.935497239, -0.047331384),
    (-14.896127525, 1.582967078, 0.245309383),
    (-13.419935741, -6.656254555, 0.585673156),
    (14.920133246, -1.337917758, 1.002038649),
    (14.673943568, -3.012603554, 2.132904453),
]


def body(model, parent, joint, name, place=None):
    """The number of a new joint with a body."""
    return add(model, parent, joint, name, place or at(), pin.Inertia(1.0, np.zeros(3), np.eye(3)))


def tilted(angle, *point):
    """A place in the plane, turned about its normal."""
    return at(*point, turned=pin.utils.rotate("z", angle))


def gough():
    """A free platform on six rods of fixed lengths."""
    model = pin.Model()
    platform = body(model, 0, pin.JointModelFreeFlyer(), "platform")
    for k, (a, b) in enumerate(zip(BASE, PLATFORM, strict=True)):
        mark(model, 0, f"a{k}", at(*a))
        mark(model, platform, f"b{k}", at(*b))
    rods = [sst_pin.Distance(f"a{k}", f"b{k}", length) for k, length in enumerate(LEGS)]
    return sst_pin.ClosedChain(model, rods, [])


def three_rpr():
    """Legs of hinge, slide, hinge; the platform is on the first one."""
    model = pin.Model()
    for k, point in enumerate(RPR_BASE):
        hinge = body(model, 0, pin.JointModelRZ(), f"hinge_{k}", at(*point))
        end = body(model, hinge, pin.JointModelPX(), f"leg_{k}")
        if k == 0:
            plate = body(model, end, pin.JointModelRZ(), "platform")
            for name, corner in zip("abc", RPR_PLATFORM, strict=True):
                mark(model, plate, name, at(*corner))
        else:
            mark(model, end, f"tip_{k}", at())
    closures = [sst_pin.Closure("b", "tip_1", "3d"), sst_pin.Closure("c", "tip_2", "3d")]
    return sst_pin.ClosedChain(model, closures, ["leg_0", "leg_1", "leg_2"])


def test_a_planar_3rpr_platform_has_the_poses_of_elimination():
    chain = three_rpr()
    held = {f"leg_{k}": x for k, x in enumerate(RPR_LEGS)}
    modes, again = (chain.assembly_modes(held, frame="a") for _ in range(2))
    assert np.array_equal(modes.q, again.q)
    assert len(modes) == len(RPR_POSES)
    assert not modes.complete
    p, R = chain.frame_placement(modes.q, "a")
    result = np.column_stack([p[:, :2], np.arctan2(R[:, 1, 0], R[:, 0, 0])])
    assert_allclose(sorted(result.tolist()), sorted(RPR_POSES), atol=2e-9)  # nine digits
    assert np.abs(chain.residual(modes.q)).max() < 1e-12 * max(1, chain.mechanism.length)


@pytest.mark.slow
def test_dietmaiers_platform_has_its_forty_poses():
    chain = gough()
    modes = chain.assembly_modes({})
    assert len(modes) >= 38  # six digits may lose two that are almost one
    assert not modes.complete
    assert np.abs(chain.residual(modes.q)).max() < 1e-12


@pytest.mark.parametrize("angle", [0.3, -1.2])
def test_a_four_bar_has_both_intersections_of_two_circles(angle):
    model = planar(DRAG_LINK)
    closures = [sst_pin.Closure("coupler_end", "rocker_end", "3d")]
    chain = sst_pin.ClosedChain(model, closures, ["crank"])
    modes = chain.assembly_modes({"crank": angle})
    assert modes.complete
    assert modes.branches.tolist() == [[-1], [1]]
    assert_allclose(modes.q[:, 0], angle)
    assert np.abs(chain.residual(modes.q)).max() < 1e-12
    ends, _ = chain.frame_placement(modes.q, "coupler_end")
    data = model.createData()
    pin.forwardKinematics(model, data, modes.q[0])
    across, middle = ends[1] - ends[0], (ends[0] + ends[1]) / 2
    assert np.linalg.norm(across) > 1e-3
    for name in ("coupler", "rocker"):  # the centres of the circles are on the mirror
        centre = data.oMi[model.getJointId(name)].translation
        assert across @ (middle - centre) == pytest.approx(0, abs=1e-12)


def slider_crank(kind):
    """A crank, and beside it a hinge and a slide in the order of this kind."""
    model = pin.Model()
    tip, place = body(model, 0, pin.JointModelRZ(), "crank"), at(0.3)
    if kind == "opposite":
        tip, place = body(model, tip, pin.JointModelRZ(), "hinge", place), at(0.8, 0.1)
        end = body(model, 0, pin.JointModelPX(), "slide", tilted(0.3, 0.2, 0.1))
        end_place = at(0.05, 0.02)
    elif kind == "hinge, slide":
        carrier = body(model, 0, pin.JointModelRZ(), "hinge", at(0.6, 0.1))
        end = body(model, carrier, pin.JointModelPY(), "slide", tilted(0.2, 0.1))
        end_place = at()
    else:
        carrier = body(model, 0, pin.JointModelPX(), "slide", tilted(-0.2, 0.1, -0.1))
        end, end_place = body(model, carrier, pin.JointModelRZ(), "hinge", at(0, 0.1)), at(0.7)
    mark(model, tip, "tip", place)
    mark(model, end, "end", end_place)
    return sst_pin.ClosedChain(model, [sst_pin.Closure("tip", "end", "3d")], ["crank"])


@pytest.mark.parametrize("kind", ["opposite", "hinge, slide", "slide, hinge"])
def test_hinge_and_slide_close_in_two_ways(kind):
    """A circle and a line meet in two points."""
    chain = slider_crank(kind)
    modes = chain.assembly_modes({"crank": -2.0})
    assert modes.complete
    assert len(modes) == 2
    assert np.abs(np.diff(modes.q, axis=0)).max() > 0.1
    assert np.abs(chain.residual(modes.q)).max() < 1e-12


def test_dyads_behind_dyads_are_closed_in_order():
    """An excavator: three cylinders and a four-bar behind one of them."""
    chain = robots.excavator()
    names = chain.position_names
    held = {name: chain.home[names.index(name)] for name in chain.coordinates}
    modes = chain.assembly_modes(held)
    assert modes.complete
    assert modes.q.shape[0] == 16
    assert np.abs(chain.residual(modes.q)).max() < 1e-12
    assert min(np.abs(np.angle(np.exp(1j * (q - chain.home)))).max() for q in modes.q) < 1e-9


def test_out_of_reach_there_is_no_mode():
    chain = robots.five_bar()
    modes = chain.assembly_modes(dict(zip(chain.coordinates, [np.pi, 0.0], strict=True)))
    assert modes.q.shape == (0, chain.model.nq)
    assert modes.complete


def test_an_sst_has_the_eight_assemblies_of_its_closed_form():
    robot = sst_pin.SST()
    gamma = [0.7, 0.8, 0.75]
    modes = robot.assembly_modes(dict(zip(robot.coordinates, gamma, strict=True)))
    solutions = robot.forward_kinematics(gamma)
    assert len(modes) == len(solutions) == 8
    assert modes.complete
    for q in solutions:
        assert np.abs(np.sin((modes.q - q) / 2)).max(axis=1).min() < 1e-12


@pytest.mark.parametrize("positions", [{}, {"shoulder_1": 0.5}, {"motor_1": 0.1}, None])
def test_positions_that_leave_a_freedom_or_name_no_joint_are_refused(positions):
    with pytest.raises((sst_pin.InputError, sst_pin.UnknownNameError)):
        robots.five_bar().assembly_modes(positions)


def test_a_continuum_of_configurations_is_named():
    """Coupler and rocker of a folded kite turn together about the end of the crank."""
    chain = robots.four_bar(crank=0.3, coupler=0.25, rocker=0.25, ground=0.3, point=0.2)
    with pytest.raises(sst_pin.InputError, match="coupler, rocker can move"):
        chain.assembly_modes({"crank": 0.0})
    assert len(chain.assembly_modes({"crank": 0.1})) == 2
