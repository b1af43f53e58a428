# SPDX-License-Identifier: BSD-2-Clause
"""Pinocchio by its own loader and its own constrained dynamics."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from sst_pin.dynamics.runge_kutta import runge_kutta_step

from . import CLOSURES, Array, Tool

#: Step of the Runge-Kutta method, [s].
_STEP = 1e-3


class Pinocchio(Tool):
    name = "Pinocchio"
    module = "pinocchio"
    distribution = "pin"
    closing = "`constraintDynamics`"

    def __init__(self, folder: Path) -> None:
        path = str(folder / self.file)
        self._model, _, visual = pin.buildModelsFromUrdf(path, package_dirs=str(folder))
        self._data = self._model.createData()
        self.joints = list(self._model.names)[1:]
        self.mass = pin.computeTotalMass(self._model)
        self.visuals = visual.ngeoms

    def frame_poses(self, q: Array) -> dict[str, Array]:
        pin.framesForwardKinematics(self._model, self._data, q)
        return {
            frame.name: placement.homogeneous.copy()
            for frame, placement in zip(self._model.frames, self._data.oMf, strict=True)
            if frame.type == pin.FrameType.BODY
        }

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return pin.rnea(self._model, self._data, q, v, a)

    def fall(self, q0: Array, duration: float) -> Array:
        model, data = self._model, self._data
        closures = []
        for pair in CLOSURES:
            frames = (model.frames[model.getFrameId(name)] for name in pair)
            ends = (part for f in frames for part in (f.parentJoint, f.placement))
            closures.append(
                pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, *ends, pin.LOCAL)
            )
        state = [closure.createData() for closure in closures]
        # Twelve rows of rank six: without regularisation it returns NaN.
        settings = pin.ProximalSettings(1e-14, 1e-6, 10)
        pin.initConstraintDynamics(model, data, closures, state)

        def rate(_: int, x: Array) -> Array:
            q, v = np.split(x, 2)
            free = np.zeros(model.nv)
            a = pin.constraintDynamics(model, data, q, v, free, closures, state, settings)
            return np.concatenate([v, a])

        x = np.concatenate([q0, np.zeros(model.nv)])
        for _ in range(round(duration / _STEP)):
            x = runge_kutta_step(rate, x, _STEP)
        return x[: model.nq]
