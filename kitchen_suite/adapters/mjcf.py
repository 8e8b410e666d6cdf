"""Exports the scene of an episode as files that `mujoco` alone loads."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import importlib.metadata
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from dm_env import specs

from kitchen_suite import files
from kitchen_suite.environment import Environment
from kitchen_suite.environment.mjcf_values import Difference, greatest_difference, write_values
from kitchen_suite.environment.physics_state import INTEGRATION_STATE
from kitchen_suite.episodes.spec import EnvironmentSpec, reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.tasks.requests import VARIATION_VALUES
from kitchen_suite.versions import installed_versions

LICENCE_FILE = "LICENSE-gymnasium-robotics.txt"  # File with the licence of the installed meshes and textures.

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

_PAGE_TEMPLATE = """\
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

XML_FILE, BINARY_FILE, STATE_FILE = "scene.xml", "scene.mjb", "state.npz"
METADATA_FILE, PAGE_FILE = "scene.json", "README.md"

_ASSETS = "assets"  # Folder of meshes and textures, beside the XML.
_KEYFRAME = "start"  # Name of the keyframe with the start of the episode, for viewers.


def page(record: Mapping[str, Any]) -> str:
    """Returns the page of a scene with given metadata, those of its JSON file."""
    action = record["action"]
    positions = {joint["name"]: joint["qposadr"] for joint in record["joints"]}
    return _PAGE_TEMPLATE.format(
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


def export(
    folder: Path, spec: EnvironmentSpec, *, seed: int = 0, variation_values: Mapping[str, Any] | None = None
) -> dict[str, Difference]:
    """Writes the scene of an episode, and how it is stepped, to a folder that is whole or not there.

    Args:
      folder: to write, which must not exist or be empty.
      spec: of the environment.
      seed: of the reset.
      variation_values: values of parameters that vary, in place of drawn ones.

    Returns the greatest differences of the XML, as `write_scene` does.

    Raises:
      FileExistsError: the folder is not empty.
      OSError: the folder cannot be written to.
      ValueError: an argument is not valid.
    """
    if folder.exists() and any(folder.iterdir()):
        raise FileExistsError(f"{folder} is not empty: name another folder")
    if variation_values and not spec.argument("variations"):
        raise ValueError("variation_values needs variations, the parameters that vary")
    environment = spec.make_environment(visuals=True)
    options = {VARIATION_VALUES: dict(variation_values)} if variation_values else None
    with contextlib.closing(environment):
        reset_to_seed(environment, seed, "gymnasium", options)
        inner = suite_env(environment).environment
        with files.atomic_folder(folder) as partial:
            partial.mkdir()
            described = _metadata(spec, inner, seed)
            differences = write_scene(partial, inner)
            record = {**described, **{name: each._asdict() for name, each in differences.items()}}
            files.write_json(partial / METADATA_FILE, record)
            (partial / PAGE_FILE).write_text(page(record), encoding="utf-8")
    return differences


def _metadata(spec: EnvironmentSpec, environment: Environment, seed: int) -> dict[str, Any]:
    task, model = environment.task, environment.physics.model.ptr
    described = spec.as_json()
    return {
        **{name: described[name] for name in ("domain_name", "task_name", "task_kwargs")},
        "seed": seed,
        "max_episode_steps": spec.max_episode_steps,
        "versions": installed_versions(),
        "instruction": task.instruction,
        VARIATION_VALUES: {name: value.tolist() for name, value in task.variations.values.items()},
        "physics_timestep": model.opt.timestep,
        "control_timestep": environment.control_timestep(),
        "substeps": task.physics_steps_per_control_step,
        "state": {"file": STATE_FILE, "array": "integration", "signature": "mjSTATE_INTEGRATION"},
        "keyframe": _KEYFRAME,
        "action": _action(task.mdp.action_mode, environment.action_spec()),
        "actuators": [
            {"name": model.actuator(i).name, "ctrlrange": model.actuator_ctrlrange[i].tolist()} for i in range(model.nu)
        ],
        "joints": [_joint(model, i) for i in range(model.njnt)],
        "cameras": [model.camera(i).name for i in range(model.ncam)],
        "licences": LICENCES,
    }


def write_scene(folder: Path, environment: Environment) -> dict[str, Difference]:
    """Writes the present scene of an environment, after a reset: XML with its assets, binary model, state, licences.

    The environment cannot be used further: values that differ from the built scene are written to its MJCF. Returns the
    greatest differences of the model that the XML compiles to from the environment's, by name: of all fields, and of
    those that the physics depends on.
    """
    physics, root = environment.physics, environment.task.root_entity.mjcf_model
    model, data = physics.model.ptr, physics.data.ptr
    # MuJoCo itself reads and writes no files here: it takes a backslash for a slash, and logs what it cannot write.
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    (folder / BINARY_FILE).write_bytes(binary.tobytes())
    state = np.empty(mujoco.mj_stateSize(model, INTEGRATION_STATE))
    mujoco.mj_getState(model, data, state, INTEGRATION_STATE)
    np.savez(folder / STATE_FILE, integration=state)
    write_values(root, mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets()), model)
    root.keyframe.add("key", name=_KEYFRAME, qpos=data.qpos, qvel=data.qvel, ctrl=data.ctrl)
    # With all digits of its numbers, and its assets in a folder of their own.
    tree = ElementTree.fromstring(root.to_xml_string())
    compiler = tree.find("compiler")
    assert compiler is not None
    compiler.set("assetdir", _ASSETS)
    ElementTree.indent(tree)
    ElementTree.ElementTree(tree).write(folder / XML_FILE, encoding="utf-8")
    (folder / _ASSETS).mkdir()
    for name, contents in root.get_assets().items():
        (folder / _ASSETS / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    licences = [path for path in importlib.metadata.files("gymnasium-robotics") or () if path.name == "LICENSE"]
    for path in licences[:1]:
        (folder / LICENCE_FILE).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    assets = {f"{_ASSETS}/{path.name}": path.read_bytes() for path in (folder / _ASSETS).iterdir()}
    compiled = mujoco.MjModel.from_xml_string((folder / XML_FILE).read_text(encoding="utf-8"), assets)
    return {
        "xml_greatest_difference": greatest_difference(compiled, model),
        "xml_greatest_difference_in_physics": greatest_difference(compiled, model, physical=True),
    }


def _action(mode: Any, spec: specs.Array) -> dict[str, Any]:
    """Returns what the elements of an action are, and how controls follow from them."""
    bounds = [getattr(spec, name, np.array(None)) for name in ("minimum", "maximum")]
    elements = zip(spec.name.split("\t"), *(np.broadcast_to(each, spec.shape).tolist() for each in bounds), strict=True)
    return {
        "control_mode": mode.name,
        "meaning": " ".join((type(mode).spec.__doc__ or "").split()),
        "settings": mode.settings,
        "formula": mode.formula,
        "elements": [dict(zip(("name", "minimum", "maximum"), element, strict=True)) for element in elements],
    }


def _joint(model: mujoco.MjModel, number: int) -> dict[str, Any]:
    joint = model.joint(number)
    kind = mujoco.mjtJoint(model.jnt_type[number]).name.removeprefix("mjJNT_").lower()
    return {"name": joint.name, "type": kind, "qposadr": joint.qposadr.item(), "dofadr": joint.dofadr.item()}
