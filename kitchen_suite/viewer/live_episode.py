"""The episode in progress in a viewer, which is played step by step by a policy."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dm_control import mjcf

from kitchen_suite.closing import closed_on_error
from kitchen_suite.episodes.play import SingleRollout
from kitchen_suite.episodes.spec import EnvironmentSpec, EpisodeSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyBuilder, PolicyRef
from kitchen_suite.viewer.escaping import escaped

DEFAULT_POLICY = "random"  # That acts where none is chosen.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """The episodes to show: a task, arguments of its Gymnasium environment, and the policy that acts.

    Attributes:
      variations: that vary, as the argument of that name; None for that of `task_kwargs`.
      variation_split: of the variations, as the argument of that name; None for that of `task_kwargs`.
      policy: name of the policy; None for none.
      max_episode_steps: control steps after which an episode is truncated; None for the default.
    """

    domain_name: str
    task_name: str
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    variations: Any = None
    variation_split: str | None = None
    policy: str | None = None
    max_episode_steps: int | None = None

    def spec(self, policy: PolicyRef) -> EpisodeSpec:
        """Returns the specification of the episodes that a policy plays."""
        chosen = {"variations": self.variations, "variation_split": self.variation_split}
        kwargs = {**self.task_kwargs, **{name: value for name, value in chosen.items() if value is not None}}
        environments = EnvironmentSpec.make(self.domain_name, self.task_name, kwargs, self.max_episode_steps)
        return environments.episodes(policy, seed=0)


class LiveEpisode:
    """The episode in progress of a specification, which is played step by step.

    Attributes:
      seed: of the episode.
      spec: of the episodes.
      timestep: duration of a control step [s].
    """

    seed: int

    def __init__(self, spec: EpisodeSpec, build_policy: PolicyBuilder, *, render_quality: str = "fast") -> None:
        """Builds the environment; `start` has to be called before anything else."""
        self.spec = spec
        self._rollout = self._make_rollout(build_policy, render_quality)
        self._environment = suite_env(self._rollout.environment).environment
        self.timestep = self._environment.control_timestep()

    def _make_rollout(self, build_policy: PolicyBuilder, render_quality: str) -> SingleRollout:
        return SingleRollout(self.spec, build_policy, visuals=True, render_quality=render_quality)

    @property
    def physics(self) -> mjcf.Physics:
        """The physics, another object after a reset that compiles the model again."""
        return self._environment.physics

    @property
    def steps(self) -> int:
        """Control steps that have been made."""
        return self._rollout.buffer.steps

    @property
    def has_ended(self) -> bool:
        """Whether the episode has terminated or was truncated."""
        return self._rollout.buffer.has_ended

    @property
    def is_waiting(self) -> bool:
        """Whether time stands still until a person does something."""
        return False

    def start(self, seed: int, options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, and of the options of its reset; raises as `SingleRollout.start`."""
        self.seed = seed
        self._has_failed = False
        self._rollout.start(seed, options=options)

    def step(self) -> None:
        """Makes a control step, unless the episode has ended; raises what `SingleRollout.step` does.

        After an error, such as physics that diverges, it raises a RuntimeError until the episode is started again.
        """
        if self._has_failed:
            raise RuntimeError("the episode cannot go on: the last control step was not completed")
        if not self.has_ended:
            self._has_failed = True
            self._rollout.step()
            self._has_failed = False

    def headline(self) -> str:
        """Returns what is asked for and whether it is done, as Markdown."""
        instruction = self._environment.task.instruction
        state = " · ".join(self._state())
        return f"**{escaped(instruction)}**\n\n{state}" if instruction else state

    def report(self, more: Mapping[str, str] = MappingProxyType({})) -> str:
        """Returns the progress of the episode as Markdown: its requested tasks, reward and metrics, and more rows."""
        task = self._environment.task
        lines = []
        numbers = self._numbers()
        if completions := task.episode_completions:
            steps = {escaped(name.replace("_", " ")): step for name, step in completions.steps_by_task.items()}
            done = {name: step * self.timestep for name, step in steps.items() if step is not None}
            lines += [
                f"- **{name}**: completed after {done[name]:.1f} s" if name in done else f"- {name}" for name in steps
            ]
            numbers = {"tasks completed": f"{len(done)} of {len(steps)}", **numbers}
        # The first row is the head of the table: an empty one would be drawn as well.
        first, *rows = (f"| {key} | {it} |" for key, it in {**numbers, **more}.items())
        return "\n".join([*lines, "", first, "| --- | --- |", *rows])

    def _state(self) -> list[str]:
        """Returns the state of the episode in a few words, its success first."""
        metrics = self._environment.task.episode_metrics
        return [f"success: **{('no', 'yes')[bool(metrics['success'])]}**", f"{self.steps * self.timestep:.1f} s"]

    def _numbers(self) -> dict[str, str]:
        """Returns the rows of the report's table."""
        buffer = self._rollout.buffer
        numbers = {
            "time": f"{buffer.steps * self.timestep:.1f} s",
            "control step": f"{buffer.steps} of {self.spec.max_episode_steps}",
            "reward": f"{buffer.reward:.3f}",
            "return": f"{buffer.total_reward:.3f}",
        }
        for name, value in self._environment.task.episode_metrics.items():
            if not isinstance(value, dict):
                numbers[escaped(name.replace("_", " "))] = (
                    ("no", "yes")[value] if isinstance(value, bool) else f"{value:.3f}"
                )
        return numbers

    def close(self) -> None:
        """Frees the environment."""
        self._rollout.environment.close()


def started_episode(choice: Choice, seed: int, *, render_quality: str) -> LiveEpisode:
    """Returns the episode of a seed, which the chosen policy plays, or one of random actions."""
    policy = PolicyRef.parse(choice.policy or DEFAULT_POLICY)
    spec = choice.spec(policy).prepared(policy)
    episode = LiveEpisode(spec, policy.sequential_builder(spec.policy_sha256), render_quality=render_quality)
    with closed_on_error([episode]):
        episode.start(seed)
    return episode
