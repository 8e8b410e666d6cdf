"""An episode that is played step by step, as `kitchen-view` shows it."""

from typing import TYPE_CHECKING

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rendering import cameras
from kitchen_suite.rollouts.rollout import SingleRollout
from kitchen_suite.rollouts.spec import EpisodeSpec
from kitchen_suite.settings import ViewSettings

if TYPE_CHECKING:
    from dm_control import mjcf


class LiveEpisode:
    """The episode in progress of a task and a policy.

    Attributes:
      seed: of the episode.
    """

    def __init__(self, settings: ViewSettings) -> None:
        """Builds environment and policy, and starts the episode of the settings' seed."""
        spec = EpisodeSpec.of(settings, seeding="gymnasium")
        quality = {} if "render_quality" in spec.task_kwargs else {"render_quality": settings.render_quality}
        self._rollout = SingleRollout(spec.prepared(), visuals=True, **quality)
        self._max_steps = spec.max_episode_steps
        self._environment = suite_env(self._rollout.environment).environment
        cameras.find_camera(self.physics, settings.camera)
        self.start(settings.seed)

    @property
    def physics(self) -> "mjcf.Physics":
        """The physics, another object after a reset that compiles the model again."""
        return self._environment.physics

    @property
    def timestep(self) -> float:
        """Duration of a control step [s]."""
        return self._environment.control_timestep()

    @property
    def has_ended(self) -> bool:
        """Whether the episode has terminated or was truncated."""
        return self._rollout.buffer.has_ended

    def start(self, seed: int) -> None:
        """Starts the episode of a seed; raises a PolicyError if the policy cannot be built."""
        self.seed, self._total_reward = seed, 0.0
        self._rollout.start(seed)

    def step(self) -> None:
        """Makes a control step, unless the episode has ended; raises what `SingleRollout.step` does."""
        if not self.has_ended:
            self._rollout.step()
            self._total_reward += self._rollout.buffer.reward

    def report(self) -> str:
        """Returns the progress of the episode as Markdown: the tasks that it asks for, reward and measures."""
        task, buffer = self._environment.task, self._rollout.buffer
        numbers = {
            "time": f"{buffer.steps * self.timestep:.1f} s",
            "control step": f"{buffer.steps} of {self._max_steps}",
            "reward": f"{buffer.reward:.3f}",
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
        self._rollout.environment.close()

    def _task_line(self, name: str, step: int | None) -> str:
        name = name.replace("_", " ")
        return f"- {name}" if step is None else f"- **{name}**: completed after {step * self.timestep:.1f} s"


def _yes(value: bool) -> str:
    return "yes" if value else "no"
