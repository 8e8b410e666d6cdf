"""The work of `kitchen-export`: the scene of an episode as files that `mujoco` alone loads."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import importlib.metadata
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import mujoco
import numpy as np
from dm_env import specs

from kitchen_suite import files
from kitchen_suite.adapters.mjcf_values import Difference, greatest_difference, write_values
from kitchen_suite.environment import Environment
from kitchen_suite.environment.states import PHYSICS_STATE
from kitchen_suite.episodes.spec import EnvironmentSpec, reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.settings import FAILURE, ExportSettings
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


class ExportJob:
    """Writes a scene, and how it is stepped, to a folder."""

    errors: ClassVar = {OSError: FAILURE}

    def __init__(self, settings: ExportSettings) -> None:
        """Builds the scene, and starts the episode."""
        self._folder = settings.output
        if self._folder.exists() and any(self._folder.iterdir()):
            raise FileExistsError(f"{self._folder} is not empty: name another folder")
        self._seed = settings.seed
        self._spec = EnvironmentSpec.make(settings.domain_name, settings.task_name, settings.environment_kwargs)
        if settings.variation_values and settings.variations is None and "variations" not in settings.task_kwargs:
            raise ValueError("variation_values needs --variations, the parameters that vary")
        self._gymnasium_env = self._spec.make_environment(visuals=True)
        options = {VARIATION_VALUES: dict(settings.variation_values)} if settings.variation_values else None
        reset_to_seed(self._gymnasium_env, settings.seed, "gymnasium", options)
        self._environment = suite_env(self._gymnasium_env).environment

    def progress(self) -> str:
        return "before the folder was complete; nothing was written"

    def run(self) -> bool:
        """Writes all files; prints the folder, and the difference of the XML."""
        with contextlib.closing(self._gymnasium_env), files.atomic_folder(self._folder) as folder:
            folder.mkdir()
            differences = write_scene(folder, self._environment)
            record = {**self._metadata(), **{name: each._asdict() for name, each in differences.items()}}
            files.write_json(folder / METADATA_FILE, record)
            (folder / PAGE_FILE).write_text(page(record), encoding="utf-8")
        print(f"{self._spec.domain_name} {self._spec.task_name}, seed {self._seed}, in {self._folder}")
        print(f"{BINARY_FILE}: the environment's model, to the bit")
        for name, difference in differences.items():
            print(f"{XML_FILE}: {name.removeprefix('xml_').replace('_', ' ')}: {difference}")
        return True

    def _metadata(self) -> dict[str, Any]:
        task, model = self._environment.task, self._environment.physics.model.ptr
        spec = self._spec.as_json()
        values = {name: value.tolist() for name, value in task.variations.values.items()}
        return {
            **{name: spec[name] for name in ("domain_name", "task_name", "task_kwargs")},
            "seed": self._seed,
            "max_episode_steps": spec["max_episode_steps"],
            "versions": installed_versions(),
            "instruction": task.instruction,
            VARIATION_VALUES: values,
            "physics_timestep": model.opt.timestep,
            "control_timestep": self._environment.control_timestep(),
            "substeps": task.physics_steps_per_control_step,
            "state": {"file": STATE_FILE, "array": "integration", "signature": "mjSTATE_INTEGRATION"},
            "keyframe": _KEYFRAME,
            "action": _action(task.mdp.action_mode, self._environment.action_spec()),
            "actuators": [
                {"name": model.actuator(i).name, "ctrlrange": model.actuator_ctrlrange[i].tolist()}
                for i in range(model.nu)
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
    state = np.empty(mujoco.mj_stateSize(model, PHYSICS_STATE))
    mujoco.mj_getState(model, data, state, PHYSICS_STATE)
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
