# SPDX-License-Identifier: BSD-2-Clause
"""Direct dynamics by Pinocchio's own `constraintDynamics`, right for trees added depth-first."""

import pinocchio as pin

#: Regularisation of the multipliers: without it, redundant closures give NaN without an error.
MU = 1e-6
KINDS = {"6d": pin.ContactType.CONTACT_6D, "3d": pin.ContactType.CONTACT_3D}


def joint_accelerations(model, closures, q, v, force):
    """v_dot under forces on the rates; closures of kind "6d" or "3d"."""
    constraints = []
    for closure in closures:
        ends = [model.frames[model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b)]
        placements = [part for end in ends for part in (end.parentJoint, end.placement)]
        kind = KINDS[closure.kind]
        constraints.append(pin.RigidConstraintModel(kind, model, *placements, pin.LOCAL))
    data, settings = model.createData(), pin.ProximalSettings(1e-14, MU, 20)
    workspaces = [constraint.createData() for constraint in constraints]
    pin.initConstraintDynamics(model, data, constraints, workspaces)
    return pin.constraintDynamics(model, data, q, v, force, constraints, workspaces, settings)
