"""A custom arm in the kitchen, with the scripted expert. Run: python my_arm.py; it needs the extra `experts`."""

import numpy as np

from kitchen_suite import experts, suite
from kitchen_suite.entities import RobotSpec
from kitchen_suite.entities.robot import prepare_mjcf

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control import mjcf

# Joints a to f from the base outwards, and two fingers; usually a file, which `entities.robot.load_mjcf` reads.
MJCF = """
<mujoco>
  <compiler angle="radian"/>
  <default>
    <joint damping="1" armature="0.1" range="-3 3"/>
    <geom type="capsule" size="0.04" density="500"/>
    <position kp="2000" kv="200" ctrlrange="-3 3"/>
    <default class="finger">
      <geom type="box" size="0.01 0.008 0.045" pos="0 0 0.045"/>
      <joint type="slide" range="0 0.04"/>
      <position kp="1000" kv="100" ctrlrange="0 0.04"/>
    </default>
  </default>
  <worldbody>
    <body> <geom fromto="0 0 0 0 0 0.15"/>
      <body pos="0 0 0.25"> <joint name="a" axis="0 0 1"/> <geom size="0.05" fromto="0 -0.05 0 0 0.05 0"/>
        <body> <joint name="b" axis="0 1 0"/> <geom fromto="0 0 0.1 0 0 0.4"/>
          <body pos="0 0 0.5"> <joint name="c" axis="0 1 0"/> <geom fromto="0 0 0.1 0 0 0.2"/>
            <body pos="0 0 0.25"> <joint name="d" axis="0 0 1"/> <geom fromto="0 0 0.04 0 0 0.1"/>
              <body pos="0 0 0.2"> <joint name="e" axis="0 1 0"/> <geom size="0.035" fromto="0 0 0 0 0 0.02"/>
                <body pos="0 0 0.12">
                  <joint name="f" axis="0 0 1"/> <geom size="0.03" fromto="0 0 -0.05 0 0 0"/>
                  <site name="end_effector" pos="0 0 0.09"/> <!-- 0.05 m before the tips of the fingers. -->
                  <body childclass="finger" pos="0 0.008 0.05"> <joint name="left" axis="0 1 0"/> <geom/> </body>
                  <body childclass="finger" pos="0 -0.008 0.05"> <joint name="right" axis="0 -1 0"/> <geom/> </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a"/> <position name="b" joint="b"/> <position name="c" joint="c"/>
    <position name="d" joint="d"/> <position name="e" joint="e"/> <position name="f" joint="f"/>
    <position name="left" joint="left" class="finger"/> <position name="right" joint="right" class="finger"/>
  </actuator>
</mujoco>
"""

MY_ARM = RobotSpec(
    name="my_arm",
    load=lambda visuals: prepare_mjcf(mjcf.from_xml_string(MJCF), visuals=visuals),
    servos={name: name for name in "abcdef"},
    hand_actuators=("left", "right"),
    closed=0.0,
    open=0.04,
    home={"a": 0.6, "b": -0.6, "c": 2.2, "e": -0.03, "left": 0.04, "right": 0.04},
)

if __name__ == "__main__":
    arguments = {"robot": MY_ARM, "control_mode": "ee_delta_pose", "random": 0, "visuals": False}
    environment = suite.load("kitchen", "microwave", arguments)
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    print(timestep.observation["my_arm/joint_positions"].shape, environment.task.completion_steps)
