"""The web page of an evaluation."""

import contextlib

from dm_control.rl.control import PhysicsError

from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.settings import EvaluateSettings
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rendering import cameras
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.page import Page, PageStep
from kitchen_suite.rollouts.single_rollout import SingleRollout
from kitchen_suite.rollouts.spec import RecordingSpec


class EpisodePage:
    """Plays the first episodes of each condition again, one by one, for a web page, if one is asked for.

    An episode depends on nothing but its seed: these are the episodes that were evaluated.
    """

    def __init__(self, settings: EvaluateSettings, plan: EvaluationPlan) -> None:
        """Checks that the page can be made.

        Raises:
          ImportError: the extra is missing.
          ValueError: there is no such camera.
        """
        self._settings, self._plan = settings, plan
        self._count = min(settings.web_episodes, plan.num_episodes)
        self._page = Page(settings, num_episodes=self._count * len(plan.specs))
        if settings.web:
            with contextlib.closing(plan.first.make_environment()) as environment:
                cameras.find_camera(suite_env(environment).environment.physics, settings.camera)

    def write(self) -> None:
        """Plays the episodes, and writes the page.

        Raises:
          OSError: the page cannot be written.
          PolicyError: the policy raised an exception, or returned a bad action.
        """
        if self._settings.web is None:
            return
        with self._page.open() as show:
            for name, spec in self._plan.specs.items():
                self._play(f"{name}, " if len(self._plan.specs) > 1 else "", spec, show)

    def _play(self, prefix: str, spec: RecordingSpec, show: PageStep) -> None:
        """Plays the episodes of a condition, whose names begin with a prefix."""
        rollout = SingleRollout(spec, visuals=True, **_light(spec))
        environment = suite_env(rollout.environment).environment

        def watch(buffer: EpisodeBuffer) -> None:
            if not buffer.steps:
                buffer.name = prefix + buffer.name
            show(buffer, environment)

        with contextlib.closing(rollout.environment):
            for index in range(self._count):
                # The page has an episode until its physics diverges.
                with contextlib.suppress(PhysicsError):
                    rollout.play(index, spec.seed + index, watch)


def _light(spec: RecordingSpec) -> dict[str, str]:
    """Returns the argument with which meshes are light, unless the episodes' pictures are of another quality."""
    return {} if "render_quality" in spec.task_kwargs else {"render_quality": "fast"}
