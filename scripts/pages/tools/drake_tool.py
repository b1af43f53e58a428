# SPDX-License-Identifier: BSD-2-Clause
"""Drake: a discrete plant, its loops closed by welds."""

from pathlib import Path

import numpy as np

from . import CLOSURES, Array, Tool


class Drake(Tool):
    name = "Drake"
    module = "pydrake"
    distribution = "drake"
    closing = "`AddWeldConstraint`"
    step = 1e-4

    def __init__(self, folder: Path) -> None:
        from pydrake.geometry import CollisionFilterDeclaration, Role
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        from pydrake.systems.framework import DiagramBuilder

        builder = DiagramBuilder()
        self._plant, scene = AddMultibodyPlantSceneGraph(builder, self.step)
        plant = self._plant
        (self._robot,) = Parser(plant).AddModels(str(folder / self.file))
        for first, second in CLOSURES:
            frames = (plant.GetFrameByName(name) for name in (first, second))
            ends = (x for frame in frames for x in (frame.body(), frame.GetFixedPoseInBodyFrame()))
            plant.AddWeldConstraint(*ends)
        # One body in three parts: as such they may overlap.
        arcs = [plant.GetBodyByName(f"star_{k}") for k in (1, 2, 3)]
        one = CollisionFilterDeclaration().ExcludeWithin(plant.CollectRegisteredGeometries(arcs))
        scene.collision_filter_manager().Apply(one)
        plant.Finalize()
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._state = plant.GetMyContextFromRoot(self._context)
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        self.joints = [joint.name() for joint in joints if joint.num_positions()]
        self.mass = plant.CalcTotalMass(self._state)
        self.visuals = scene.model_inspector().NumGeometriesWithRole(Role.kIllustration)

    def frame_poses(self, q: Array) -> dict[str, Array]:
        plant, state = self._plant, self._state
        plant.SetPositions(state, q)
        bodies = (plant.get_body(i) for i in plant.GetBodyIndices(self._robot))
        return {b.name(): plant.EvalBodyPoseInWorld(state, b).GetAsMatrix4() for b in bodies}

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        from pydrake.multibody.tree import MultibodyForces

        plant, state = self._plant, self._state
        plant.SetPositionsAndVelocities(state, np.concatenate([q, v]))
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(state, forces)
        return plant.CalcInverseDynamics(state, a, forces)

    def fall(self, q0: Array, duration: float) -> Array:
        from pydrake.systems.analysis import Simulator

        self._plant.SetPositionsAndVelocities(self._state, np.concatenate([q0, 0 * q0]))
        Simulator(self._diagram, self._context).AdvanceTo(duration)
        return self._plant.GetPositions(self._state)
