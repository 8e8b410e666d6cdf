"""The tasks of Kitchen Suite as a benchmark of vla-eval; docs/guide/vla_eval.md describes its configs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.render import apply_env
from vla_eval.specs import IMAGE_RGB, LANGUAGE, DimSpec
from vla_eval.types import Action, EpisodeResult, Observation, Task

from kitchen_suite import checks, suite
from kitchen_suite.episodes.spec import EnvironmentSpec, reset_to_seed
from kitchen_suite.evaluation.plan import EvaluationPlan, Replaced, make_unprepared_plan
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.lerobot.observations import AGENT_POS, ENVIRONMENT_STATE, OBS_TYPES, PIXELS, LeRobotObservations
from kitchen_suite.policies import PolicyRef

# Key of what policies of the suite act on, and name of the argument that adds it.
SUITE_OBSERVATION = "suite_observation"

# Format of numbers that servers do not describe.
_RAW = "raw"

# Renders on the processor: Mesa's library in place of a driver's, where it is installed as Debian does.
_MESA = Path("/usr/share/glvnd/egl_vendor.d/50_mesa.json")
_SOFTWARE = {"LIBGL_ALWAYS_SOFTWARE": "1", **({"__EGL_VENDOR_LIBRARY_FILENAMES": str(_MESA)} if _MESA.exists() else {})}


class KitchenSuiteBenchmark(StepBenchmark):
    """Tasks of a domain of the suite.

    Episode number `i` of a task is that of seed `seed + i`: it starts as in `kitchen-record`, whatever was played
    before. It ends when its environment terminates it, and at the limit of its control steps.

    Observations have `task_description`, the task's sentence; `state`, joint positions and velocities of the robot;
    with the default `obs_type` also `environment_state`; with pictures `images` by camera, `(height, width, 3)` uint8.
    `franka/hand` is `franka_hand` there. Actions are `(k,)`, in the control mode of the environment, and are clipped to
    its bounds.
    """

    render_backends = frozenset({"gpu", "cpu"})

    # What a recording may have of each step, by vla-eval's name of this attribute.
    _ALL_RECORD_FIELDS = frozenset({"reward", "done", "success", "action", "state"})

    def __init__(
        self,
        domain_name: str = "kitchen",
        tasks: Sequence[str] | None = None,
        seed: int = 0,
        max_episode_steps: int | None = None,
        task_kwargs: Mapping[str, Any] | None = None,
        suite_observation: bool = False,
        protocol: str | None = None,
    ) -> None:
        """Checks the arguments, which are the `params` of a config, and builds the environment of the first task.

        Args:
          domain_name: `kitchen`, `open_cabinet`, `microwave_table`, `kitchens` or `pick_and_place`, or `module:NAME` of
            a user's own.
          tasks: names of tasks of the domain; all of them when None.
          seed: of the first episode of each task; the others have the next ones.
          max_episode_steps: control steps of an episode; the domain's when None.
          task_kwargs: further arguments of the Gymnasium environment, such as `obs_type`, `cameras` and `physics`.
          suite_observation: whether observations also have the suite's own, without pictures, by the key
            `suite_observation`. Servers that need it set it.
          protocol: name of a protocol of `kitchen-evaluate` whose conditions are played in place of `tasks`, from its
            own seeds; only one whose scores are successes and completed tasks. `episodes_per_task` is the config's.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown domain or task, or a value that is refused.
        """
        super().__init__()
        self._seed = checks.integer(seed, "seed", minimum=0)
        self._sends_suite_observation = checks.boolean(suite_observation, SUITE_OBSERVATION)
        task_kwargs = {"obs_type": OBS_TYPES[0], **(task_kwargs or {})}
        if protocol is None:
            names = suite.find_domain(domain_name).tasks if tasks is None else checks.unique_names(tasks, "tasks")
            self._specs = {
                name: EnvironmentSpec.make(domain_name, name, task_kwargs, max_episode_steps)
                for name in map(str, names)
            }
        else:
            if tasks is not None or seed:
                raise ValueError(f"protocol {protocol!r} has tasks and a seed of its own: give none")
            plan = _plan(protocol, domain_name, task_kwargs, max_episode_steps)
            self._seed = plan.first.seed
            self._specs = {
                name: EnvironmentSpec.make(each.domain_name, each.task_name, each.task_kwargs, each.max_episode_steps)
                for name, each in plan.specs.items()
            }
        self._present = ""
        self._environment: gymnasium.Env | None = None
        self._build(next(iter(self._specs)))

    def _build(self, name: str) -> None:
        """Builds the environment of a task, unless it is the present one."""
        if name != self._present:
            self.cleanup()
            self._environment = self._specs[name].make_environment(disable_env_checker=True)
            self._present, self._observations = name, LeRobotObservations(self._inner)

    @property
    def _inner(self) -> SuiteEnv:
        assert self._environment is not None
        return suite_env(self._environment)

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        return apply_env(_SOFTWARE) if mode == "cpu" else {}

    def get_tasks(self) -> list[Task]:
        """Returns the tasks; beside their names they have what a server needs to build a policy for an episode."""
        return [
            {"name": name, "suite": spec.domain_name, "seed": self._seed, "environment": json.dumps(spec.as_json())}
            for name, spec in self._specs.items()
        ]

    def reset(self, task: Task) -> Any:
        self._build(task["name"])
        observation, _ = reset_to_seed(self._environment, self._seed + task["episode_idx"], "gymnasium")
        self._recorder.record_video(self._frame(observation))
        return observation

    def step(self, action: Action) -> StepResult:
        if "actions" not in action:
            raise ValueError(f"the server's answer has no 'actions', but {sorted(map(str, action))}")
        space = self._inner.action_space
        (size,) = space.shape
        clipped = checks.vector(action["actions"], size, "actions").clip(space.low, space.high)
        observation, reward, terminated, truncated, info = self._environment.step(clipped)
        done, success = terminated or truncated, bool(info["is_success"])
        state = self._observations(observation)[AGENT_POS]
        self._recorder.record_video(self._frame(observation))
        self._recorder.record_step(reward=reward, done=done, success=success, action=clipped, state=state)
        return StepResult(obs=observation, reward=reward, done=done, info=info)

    def make_obs(self, raw_obs: Any, task: Task) -> Observation:
        laid_out = self._observations(raw_obs)
        names = {"images": PIXELS, "state": AGENT_POS, ENVIRONMENT_STATE: ENVIRONMENT_STATE}
        observation = {name: laid_out[key] for name, key in names.items() if key in laid_out}
        if self._sends_suite_observation:
            pictures = self._inner.composer_task.pictures.by_name
            present = self._inner.present_observation.items()
            observation[SUITE_OBSERVATION] = {key: value for key, value in present if key not in pictures}
        return {**observation, "task_description": self._inner.instruction}

    def get_step_result(self, step_result: StepResult) -> EpisodeResult:
        """Returns `success`, and `progress`: the number of completed tasks, or the opening of a drawer or door."""
        progress = self._inner.composer_task.records.progress(step_result.info)
        return {"success": bool(step_result.info["is_success"]), "progress": float(progress)}

    def get_metric_keys(self) -> dict[str, str]:
        return {"success": "mean", "progress": "mean"}

    def get_metadata(self) -> dict[str, Any]:
        return {"max_steps": self._specs[self._present].max_episode_steps}

    def get_action_spec(self) -> dict[str, DimSpec]:
        (size,), mode = self._inner.action_space.shape, self._inner.composer_task.mdp.action_mode.name
        return {"actions": DimSpec("actions", size, mode, accepts=frozenset({mode, _RAW}))}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        boxes = self._observations.space.spaces
        names = {"state": AGENT_POS, ENVIRONMENT_STATE: ENVIRONMENT_STATE}
        numbers = {name: DimSpec(name, boxes[key].shape[0], _RAW) for name, key in names.items() if key in boxes}
        pictures = {"image": IMAGE_RGB} if PIXELS in boxes else {}
        return {**numbers, **pictures, "language": LANGUAGE}

    def cleanup(self) -> None:
        if self._environment is not None:
            self._environment.close()
        self._present, self._environment = "", None

    def _frame(self, observation: Any) -> np.ndarray | None:
        """Returns the picture of the first camera; None without pictures."""
        return next(iter(self._observations(observation).get(PIXELS, {}).values()), None)


def _plan(
    protocol: str, domain_name: str, task_kwargs: Mapping[str, Any], max_episode_steps: int | None
) -> EvaluationPlan:
    """Returns the plan of a protocol whose scores are those that vla-eval reports; other values replace its own."""
    replaced = Replaced(domain_name=domain_name, task_kwargs=task_kwargs, max_episode_steps=max_episode_steps)
    plan = make_unprepared_plan(PolicyRef.parse("zero"), protocol, replaced)
    if any(condition.goals for condition in plan.conditions.values()):
        raise ValueError(f"protocol {protocol!r} takes its goals from a recording: kitchen-evaluate plays it")
    if any(plan.measure_names.values()):
        raise ValueError(f"protocol {protocol!r} has scores that vla-eval does not report: kitchen-evaluate plays it")
    return plan
