"""Models in one text, which compile without the files of their meshes and textures."""

import io

import mujoco
import numpy as np
from PIL import Image

from kitchen_suite.datasets.models import without_files

WEDGE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

SCENE = """
<mujoco>
  <asset>
    <mesh name="wedge" file="wedge.obj" scale=".1 .1 .1"/>
    <texture name="wood" type="2d" file="wood.png"/>
    <texture name="check" type="2d" builtin="checker" width="8" height="8"/>
    <material name="oak" texture="wood" rgba="1 0 0 1"/>
    <material name="board" texture="check"/>
  </asset>
  <worldbody>
    <body name="toy" pos="0 0 1">
      <freejoint/>
      <geom type="mesh" mesh="wedge" material="oak"/>
      <geom type="box" size=".1 .1 .1" pos=".5 0 0" material="board"/>
    </body>
  </worldbody>
</mujoco>
"""


def test_a_model_with_meshes_and_textures_of_other_formats_compiles_without_their_files():
    png = io.BytesIO()
    Image.new("RGB", (4, 4)).save(png, "png")
    assets = {"wedge.obj": WEDGE, "wood.png": png.getvalue()}
    expected, model = (
        mujoco.MjModel.from_xml_string(SCENE, assets),
        mujoco.MjModel.from_xml_string(without_files(SCENE, assets)),
    )
    for field in ("body_mass", "body_inertia", "body_ipos", "geom_pos", "geom_size", "mat_rgba"):
        np.testing.assert_allclose(getattr(model, field), getattr(expected, field), rtol=1e-5, atol=1e-7)
    assert model.ntex == 1
