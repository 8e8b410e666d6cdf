"""The README of an exported scene."""

from collections.abc import Mapping
from typing import Any

from kitchen_suite.bridges.model_difference import Difference

# File with the licence of the installed meshes and textures.
LICENCE_FILE = "LICENSE-gymnasium-robotics.txt"

# Works in the folder, and those that its numbers come from.
LICENCES = (
    {
        "of": "meshes and textures, and the parameters of the kitchen's furniture",
        "source": "FrankaKitchen-v1 of Gymnasium-Robotics, https://github.com/Farama-Foundation/Gymnasium-Robotics",
        "licence": f"MIT, Copyright 2022 Farama Foundation: {LICENCE_FILE}",
    },
    {
        "of": "the kitchen's meshes and textures within it",
        "source": "Relay Policy Learning, https://github.com/google-research/relay-policy-learning",
        "licence": "Apache License 2.0, https://www.apache.org/licenses/LICENSE-2.0, Copyright 2020 Google LLC",
    },
    {
        "of": "the Franka's meshes within it",
        "source": "https://github.com/vikashplus/franka",
        "licence": "Apache License 2.0, Copyright Vikash Kumar",
    },
    {
        "of": "the MJCF",
        "source": "Kitchen Suite, whose file NOTICE names the sources of its parameters",
        "licence": "Apache License 2.0, Copyright 2026 The Kitchen Suite authors",
    },
)

_PAGE = """\
# {domain_name} {task_name}

A scene exported by `kitchen-export`, which `mujoco` alone loads.

| file | contents |
| --- | --- |
| `scene.mjb` | the environment's model, to the bit; for MuJoCo {mujoco} alone |
| `scene.xml`, `assets/` | MJCF with meshes and textures, whose model differs by at most {difference} |
| `state.npz` | state of the physics after the reset of seed {seed}, with `mjSTATE_INTEGRATION` |
| `scene.json` | timesteps, actuators, action, joints, cameras, values of variations, licences |

In fields that the physics depends on, `scene.xml` differs by at most {in_physics}. Its keyframe `{keyframe}` is for
viewers: MuJoCo normalises quaternions in keyframes, so it may differ from the state in `state.npz`.

## Stepping

A control step of {control_timestep:g} s has {substeps} physics steps of {physics_timestep:g} s, with the same controls.

```python
import mujoco
import numpy as np

model = mujoco.MjModel.from_binary_path("scene.mjb")  # or from_xml_path("scene.xml")
data = mujoco.MjData(model)
state = np.load("state.npz")["integration"]
mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
for controls in np.tile(data.qpos[[{robot_qpos}]], (10, 1)):
    data.ctrl[:] = controls
    mujoco.mj_step(model, data, {substeps})
print(data.qpos)
```

Given the environment's controls, `data.qpos` and `data.qvel` are those of the environment, to the bit, on the same
MuJoCo and kind of processor.

## Action

Control mode `{control_mode}`: {meaning}

    {formula}

`action` in `scene.json` has its elements and settings. `ctrl` has one target for each actuator, in the order of
`actuators`.

## Cameras

{cameras}

## Licences

{licences}
"""


def page(record: Mapping[str, Any]) -> str:
    """Returns the page of a scene with given metadata, those of its JSON file."""
    action = record["action"]
    positions = {joint["name"]: joint["qposadr"] for joint in record["joints"]}
    return _PAGE.format(
        **{name: record[name] for name in ("domain_name", "task_name", "seed", "keyframe")},
        **{name: record[name] for name in ("control_timestep", "physics_timestep", "substeps")},
        **{name: action[name] for name in ("control_mode", "meaning", "formula")},
        mujoco=record["versions"]["mujoco"],
        difference=Difference(**record["xml_greatest_difference"]),
        in_physics=Difference(**record["xml_greatest_difference_in_physics"]),
        robot_qpos=", ".join(str(positions[actuator["name"]]) for actuator in record["actuators"]),
        cameras=", ".join(f"`{camera}`" for camera in record["cameras"]),
        licences="\n".join(f"- {each['of']}: {each['source']}; {each['licence']}" for each in record["licences"]),
    )
