"""Attributes of Gymnasium environments that state the task in words."""

from kitchen_suite.environment import Environment


class InstructedEnv:
    """An environment with the instructions of its task.

    Attributes:
      task: the instruction, under the name of LeRobot's environments and data sets.
      task_description: the instruction, under the other name that LeRobot reads.
    """

    _environment: Environment

    @property
    def instruction(self) -> str:
        """The task's sentence; the empty string if the task has none."""
        return self._environment.task.instruction

    @property
    def instructions(self) -> tuple[str, ...]:
        """The task's sentence, then paraphrases of it."""
        return self._environment.task.instructions

    task = task_description = instruction
