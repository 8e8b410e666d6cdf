"""Instructions: tasks in words, for policies that are conditioned on language.

The instructions of a task are a tuple of strings: first the task's sentence, then paraphrases of it. They are commands
in lower case without a full stop. A task without a sentence has the empty tuple.
"""

from collections.abc import Iterable

import numpy as np

# Between the sentences of several tasks.
SEPARATOR = ", then "

# The same goal in every scene that has the microwave.
OPEN_MICROWAVE = (
    "open the microwave door",
    "open the microwave",
    "pull the door of the microwave open",
    "swing the microwave door open",
)


def joined(parts: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    """Joins the instructions of several tasks, in the order given.

    Args:
      parts: instructions of each task.

    Returns:
      Instructions of all tasks together: the first joins the sentences, the next ones the first paraphrases, the second
      paraphrases and so on, as many as every task has. Empty if a task has none.
    """
    return tuple(SEPARATOR.join(sentences) for sentences in zip(*parts, strict=False))


def checked(instructions: object, owner: str) -> tuple[str, ...]:
    """Returns instructions if they are a tuple of strings that are not empty; `owner` is named in the message.

    Raises:
      TypeError: they are no tuple of strings.
      ValueError: one is empty.
    """
    if not isinstance(instructions, tuple) or not all(isinstance(each, str) for each in instructions):
        raise TypeError(f"instructions of {owner} must be a tuple of strings, got {instructions!r}")
    if not all(each.strip() for each in instructions):
        raise ValueError(f"instructions of {owner} must not be empty strings, got {instructions!r}")
    return instructions


def draw(instructions: tuple[str, ...], generator: np.random.Generator) -> str:
    """Returns one of the instructions, each with the same probability.

    Raises:
      TypeError: `generator` is no `numpy.random.Generator`.
      ValueError: there are none.
    """
    if not isinstance(generator, np.random.Generator):
        raise TypeError(f"generator must be a numpy.random.Generator, got {generator!r}")
    if not instructions:
        raise ValueError("there are no instructions to draw from: the task has no sentence")
    return instructions[generator.integers(len(instructions))]
