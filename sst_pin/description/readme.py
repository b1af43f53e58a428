# SPDX-License-Identifier: BSD-2-Clause
"""The README of a description: what the files are and where each number comes from."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .parameters import Parameters, RigidBody

_HEAD = """\
# The SST as a description package

![The SST in its home pose](sst.png)

The SST is a 3-RRP spherical parallel manipulator: three motors on the base rotate a star about the
fixed centre O. This folder describes it for simulators, planners and viewers. The folder is complete,
so you can copy it. `sst-pin describe` generates it. For another robot use
`sst-pin describe -o FOLDER` with options, or with `--robot` and an edited `sst.urdf`.

| file | content |
|---|---|
| `sst.urdf` | the tree: three legs, each with its arc of the star; masses, inertias, friction, geometry |
| `sst.yaml` | the two loop closures, the motors, gravity: data that a URDF cannot contain |
| `sst.srdf` | named poses `home` and `circle_start`, passive joints, pairs of links that always touch |
| `sst.xml` | MJCF: the closed robot with welds, motors `gamma_1..3`, sensors, the named poses as keyframes |
| `scene.xml` | `sst.xml` with floor, light and camera |
| `meshes/` | STL and OBJ of the parts, metres |
| `sst.png` | the picture above |
| `package.xml`, `CMakeLists.txt` | ROS 2 package `sst_description`, built by colcon |
| `LICENSE` | BSD-2-Clause |

## How to load it

```python
import mujoco, pinocchio, sst_pin

robot = sst_pin.SST.from_urdf("sst.urdf")                    # closed: kinematics and dynamics
wrapper = sst_pin.load("sst.urdf")                           # pin.RobotWrapper: model, q0, visual_model, collision_model
tree = pinocchio.buildModelFromUrdf("sst.urdf")              # the tree only: your solver needs the closures
closed = mujoco.MjModel.from_xml_path("scene.xml")           # closed; keyframe 0 is home
```

Mesh names are relative to this folder. If a tool needs a package directory, use this folder.

## How the loops are cut

There are three legs `base - gamma_k - link_k - mu_k - passive_k - beta_k - star_k` with nine
revolute joints. All axes pass through the centre O. The star is cut into its three arcs: `star_k` has
a third of its mass and of its inertia, about the star's mass centre. The frames `closedloop1_A` (on
`star_1`) and `closedloop1_B` (on `star_2`), `closedloop2_A` (on `star_1`) and `closedloop2_B` (on
`star_3`) are copies of {E} on each arc, with their origin in O. If they coincide, the three arcs form
body 7 of the paper. `sst.yaml` names these pairs in the LAAS "extended URDF" schema (`closed_loop`,
`type`, `name_mot`); the key `gravity` is an addition. In `sst.xml` the same frames are sites with
welds.

The frames `E` and `P_1..3` are the points with these names on the star and the base. Frames are
fixed links with an explicit zero inertial, because no tool adds a mass to such a link. The root link
`world` is empty and `base` is fixed to it: tools fix a link with this name to the ground, PyBullet
treats it as massless, and KDL does not accept an inertial in the root. Every joint is `revolute` with
limits of one turn in each direction, because a `continuous` joint would have two coordinates in
Pinocchio. The paper gives no limits.

## Source of the numbers

Grades: A, printed in the paper (Akbarzadeh, Enferadi, Sharifnia, doi:10.1007/s11044-012-9321-z); B,
computed by a formula of the paper from such numbers; C, chosen here, not in the paper; U, given by
the user who described this robot.

"""

_SHAPES = """
## Shapes

The paper gives axes and two radii. The parts are a possible design with these dimensions. They move
in concentric shells about O:

| body | part |
|---|---|
| `base` | motors on a ball at O, with shafts along -e_k; frame P1P2P3 on spokes; stand |
| `link_k` | arm from the motor's shaft around the outside of the frame to the axis O-R_k |
| `passive_k` | carriage on this axis: four rollers hold the arc |
| `star_k` | quarter arc from E; `star_1` also has the hub and the tool |

Visuals are the meshes `meshes/*.obj`, which Pinocchio, MuJoCo, PyBullet, yourdfpy and Drake read. The
same meshes are there as STL, for tools that do not read OBJ. Lengths are in metres, file names are
relative to the URDF. Collision geometries are boxes, cylinders and spheres of the same solids, at
most 3 mm away from the mesh, except at the two cones. In `sst.xml` they collide with the environment
but not with each other. For a left-handed triangle the motors and arcs change sides. If a carriage
leaves its quarter arc, the model continues to move, but a real robot could not.
"""

_PAPERS = """
The distance from O is at most 0.36 m for `base` without its stand, at most 0.38 m for `link_k`, 0.38
to 0.42 m for `passive_k`, and 0.39 to 0.48 m for `star_k`. In aluminium the star would have its
2.6 kg. Along the paper's circle the smallest distance between two bodies is 7.9 mm (`link_k` over the
frame), measured on the collision primitives. This does not include the bearings, where a shaft is in
its hub: motor k with `link_k`, `link_k` with `passive_k`. The gap between rollers and arc is 0.2 mm.
The three `star_k` are one body.

## What the paper does not define

| open | used here | reason | parameter to change it |
|---|---|---|---|
| which R in Eqs. (45)-(50), 0.35 m of the base or 0.40 m of the star | 0.35 m | the legs lie on the base sphere | `link`, `passive_link` with other `center_of_mass` |
| which R in Eq. (54) | 0.40 m | the star's own radius; 2R/pi is the centroid of a quarter arc | `star` with another `center_of_mass` |
| axes of the star's inertia: printed in {E}, whose x is s, it has no threefold symmetry about s | as printed, about the mass centre (Eq. 65) | literal reading | `star` with another `inertia` |
| gravity | 9.81 m/s^2 along -z_0 | w^g is in the model, no value is given | `gravity`, zero included |
| friction | none | tau^f is in the model, no value is given | `viscous_friction`, `coulomb_friction` on all nine joints |
"""


class _Row(NamedTuple):
    """Name and unit of a parameter, its value, and grade and source of the paper's value."""

    what: str
    value: Callable[[Parameters], ArrayLike]
    grade: str
    source: str


def _entries(body: RigidBody) -> Array:
    return body.inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]


_INERTIA = "inertia about the mass centre, xx yy zz xy xz yz, kg m^2"
_ROWS = (
    _Row(
        "directions v_k of the corners P_k of the base, hence the frames {0k}",
        lambda p: p.base_directions,
        "A",
        "Sect. 7.1 (a), Eqs. (32), (36)",
    ),
    _Row(
        "angles alpha_k between the arcs of the star, degrees, hence {E} in {3k}",
        lambda p: np.degrees(p.arc_angles),
        "A",
        "Sect. 7.1 (b), Eqs. (30), (31), (35)",
    ),
    _Row("radius of the base, m", lambda p: p.base_radius, "A", "Sect. 7.1"),
    _Row("radius of the star, m", lambda p: p.star_radius, "A", "Sect. 7.1"),
    _Row("actuator links: mass, kg", lambda p: [b.mass for b in p.links], "A", "Sect. 7.1 (d)"),
    _Row(
        "actuator links: mass centre in {1k}, m",
        lambda p: [b.center_of_mass for b in p.links],
        "B",
        "Eqs. (45)-(47) with R = 0.35 m",
    ),
    _Row(
        f"actuator links: {_INERTIA}, axes of {{1k}}",
        lambda p: [_entries(b) for b in p.links],
        "A",
        "Sect. 7.1 (d)",
    ),
    _Row(
        "passive links: mass, kg", lambda p: [b.mass for b in p.passive_links], "A", "Sect. 7.1 (e)"
    ),
    _Row(
        "passive links: mass centre in {2k}, m",
        lambda p: [b.center_of_mass for b in p.passive_links],
        "B",
        "Eqs. (48)-(50) with R = 0.35 m",
    ),
    _Row(
        f"passive links: {_INERTIA}, axes of {{2k}}",
        lambda p: [_entries(b) for b in p.passive_links],
        "A",
        "Sect. 7.1 (e)",
    ),
    _Row("star: mass, kg", lambda p: p.star.mass, "A", "Sect. 7.1 (c)"),
    _Row(
        "star: mass centre in {E}, m",
        lambda p: p.star.center_of_mass,
        "B",
        "Eq. (54) with R = 0.40 m: 0.8/pi m along s",
    ),
    _Row(f"star: {_INERTIA}, axes of {{E}}", lambda p: _entries(p.star), "A", "Sect. 7.1 (c)"),
    _Row(
        "viscous friction of gamma_1, mu_1, beta_1, gamma_2, ..., N m s/rad",
        lambda p: p.viscous_friction,
        "C",
        "no value in the paper",
    ),
    _Row(
        "Coulomb friction of the same joints, N m",
        lambda p: p.coulomb_friction,
        "C",
        "no value in the paper",
    ),
    _Row("gravity in base axes, m/s^2", lambda p: p.gravity, "C", "no value in the paper"),
)
#: The same for every SST.
_CHOSEN = (
    (
        "limits of the joints",
        "one turn each way, 1000 N m, 1000 rad/s",
        "wide, because the paper has none",
    ),
    (
        "visual and collision shapes",
        "see below",
        "the paper fixes axes and radii only; masses do not follow the shapes",
    ),
    (
        "time step, integrator and welds of `sst.xml`",
        "0.5 ms, Runge-Kutta, time constant 1 ms",
        "within 1e-5 rad of the rigid robot on the paper's circle",
    ),
)


def readme_of(p: Parameters) -> str:
    """Markdown of a description's README."""
    rows = [*(_cells(row, p) for row in _ROWS), *((w, v, "C", s) for w, v, s in _CHOSEN)]
    table = [
        "| | parameter | value | grade | source |",
        "|---|---|---|---|---|",
        *(f"| {i} | {' | '.join(cells)} |" for i, cells in enumerate(rows, start=1)),
    ]
    text = _HEAD + "\n".join(table) + "\n" + _SHAPES
    return text + _PAPERS if p == Parameters() else text


def _cells(row: _Row, p: Parameters) -> tuple[str, str, str, str]:
    value, papers = np.asarray(row.value(p)), np.asarray(row.value(Parameters()))
    if value.shape == papers.shape and np.allclose(value, papers, rtol=1e-12, atol=1e-15):
        return row.what, _text(value), row.grade, row.source
    return row.what, _text(value), "U", f"the paper's robot has {_text(papers)}"


def _text(value: Array) -> str:
    """Numbers with six digits; one row where all rows are the same."""
    if value.size > 1 and (value == value[0]).all():
        value = value[0]
    rows = np.atleast_2d(value)
    return "; ".join(", ".join(f"{x:.6g}" for x in row) for row in rows)
