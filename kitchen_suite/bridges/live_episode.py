"""An episode that is played step by step, as `kitchen-view` shows it."""

from typing import TYPE_CHECKING

import gymnasium
import numpy as np

from kitchen_suite.evaluation.plan import prepared
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import Policy
from kitchen_suite.rendering import cameras
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.spec import RecordingSpec, policy_generator, reset_to_seed
from kitchen_suite.settings import ViewSettings

if TYPE_CHECKING:
    from dm_control import mjcf


class LiveEpisode:
    """The episode in progress of a task and a policy.

    Attributes:
      seed: of the episode.
    """

    def __init__(self, settings: ViewSettings) -> None:
        """Builds environment and policy, and starts the episode of the settings' seed.

        Raises:
          ImportError: the policy needs an extra that is not installed.
          OSError: the policy names a file that cannot be read, or assets are missing.
          TypeError: an argument of the task has the wrong type, or there is no such argument.
          ValueError: an unknown name, or a value that is refused.
        """
        spec = RecordingSpec.make(
            domain_name=settings.domain_name,
            task_name=settings.task_name,
            task_kwargs=settings.environment_kwargs,
            policy=settings.policy,
            seed=settings.seed,
            seeding="gymnasium",
            max_episode_steps=settings.max_episode_steps,
        )
        # The expert gets the observables that it needs where layouts vary.
        self._spec = prepared(spec)
        quality = {} if "render_quality" in spec.task_kwargs else {"render_quality": settings.render_quality}
        self._environment = self._spec.make_environment(visuals=True, **quality)
        self._inner = suite_env(self._environment)
        cameras.find_camera(self.physics, settings.camera)
        self._build_policy = self._spec.find_policy()
        self.start(settings.seed)

    @property
    def physics(self) -> "mjcf.Physics":
        """The physics, another object after a reset that compiles the model again."""
        return self._inner.environment.physics

    @property
    def timestep(self) -> float:
        """Duration of a control step [s]."""
        return self._inner.environment.control_timestep()

    @property
    def has_ended(self) -> bool:
        """Whether the episode has terminated or was truncated."""
        return self._buffer.has_ended

    def start(self, seed: int) -> None:
        """Starts the episode of a seed; raises a PolicyError if the policy cannot be built."""
        start = reset_to_seed(self._environment, seed, self._spec.seeding)
        self.seed, self._total_reward = seed, 0.0
        self._buffer = EpisodeBuffer(*start)
        self._policy: Policy = self._build_policy(self._inner.environment, policy_generator(seed))

    def step(self) -> None:
        """Makes a control step with the policy's action; nothing after the end of the episode.

        Raises:
          PhysicsError: the physics has diverged.
          PolicyError: the policy raised an exception, or returned a bad action.
        """
        if self.has_ended:
            return
        space = self._environment.action_space
        assert isinstance(space, gymnasium.spaces.Box)
        action = np.asarray(self._policy(self._buffer.timestep(self._inner))).clip(space.low, space.high)
        observation, reward, termination, truncation, info = self._environment.step(action)
        self._buffer.add(action, observation, float(reward), termination, truncation, info)
        self._total_reward += float(reward)

    def report(self) -> str:
        """Returns the progress of the episode as Markdown: the tasks that it asks for, reward and measures."""
        task = self._inner.environment.task
        numbers = {
            "time": f"{self._buffer.steps * self.timestep:.1f} s",
            "control step": f"{self._buffer.steps} of {self._spec.max_episode_steps}",
            "reward": f"{self._buffer.reward:.3f}",
            "return": f"{self._total_reward:.3f}",
        }
        for name, value in task.episode_metrics.items():
            if not isinstance(value, dict):
                numbers[name.replace("_", " ")] = f"{value:.3f}" if not isinstance(value, bool) else _yes(value)
        lines = [f"**{task.instruction}**", ""] if task.instruction else []
        if completions := task.episode_completions:
            steps = completions.steps_by_task
            lines += [self._task_line(name, step) for name, step in steps.items()]
            completed = sum(step is not None for step in steps.values())
            numbers = {"tasks completed": f"{completed} of {len(steps)}", **numbers}
        return "\n".join([*lines, "", "| | |", "| --- | --- |", *(f"| {key} | {it} |" for key, it in numbers.items())])

    def close(self) -> None:
        """Frees the environment."""
        self._environment.close()

    def _task_line(self, name: str, step: int | None) -> str:
        name = name.replace("_", " ")
        return f"- {name}" if step is None else f"- **{name}**: completed after {step * self.timestep:.1f} s"


def _yes(value: bool) -> str:
    return "yes" if value else "no"
