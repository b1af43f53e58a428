# SPDX-License-Identifier: BSD-2-Clause
"""Render urdf/sst.png with MuJoCo; without a screen set MUJOCO_GL=egl."""

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.image import imsave

from sst_pin import PACKAGE_PATH
from sst_pin.files import write_files


def main() -> None:
    model = mujoco.MjModel.from_xml_path(f"{PACKAGE_PATH}/scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 1200, 1600) as renderer:
        renderer.update_scene(data, "front")
        fine = renderer.render().reshape(600, 2, 800, 2, 3)
    picture = fine.mean(axis=(1, 3)).astype(np.uint8)  # softens the edges
    write_files({Path(PACKAGE_PATH, "sst.png"): lambda file: imsave(file, picture)}, force=True)


if __name__ == "__main__":
    main()
