"""The gallery of tasks: the instruction, the Gymnasium id and a picture of each."""

from collections.abc import Iterator

from kitchen_suite import suite
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.microwave_table.task import GOAL as MICROWAVE_GOAL
from kitchen_suite.tasks.open_cabinet.task import INSTRUCTIONS as DRAWER_INSTRUCTIONS

# Pictures of tasks that have no picture of their own.
_OTHER_PICTURES = {"partial": "expert_complete.jpg", "open": "microwave_table.jpg"}

_INSTRUCTIONS = {
    **{name.replace(" ", "_"): goal.instructions[0] for name, goal in GOALS.items()},
    **{f"{drawer}_drawer": instructions[0] for drawer, instructions in DRAWER_INSTRUCTIONS.items()},
    "open": MICROWAVE_GOAL.instructions[0],
}


def gallery(domain: str) -> str:
    """Returns the gallery of a domain's tasks, those that are drawn at each reset left out."""
    return "\n\n".join(_entries(domain)) + "\n"


def _entries(domain: str) -> Iterator[str]:
    record = suite.DOMAINS[domain]
    for task, arguments in record.tasks.items():
        picture = _OTHER_PICTURES.get(task, f"expert_{task}.jpg")
        if "tasks_per_episode" not in arguments:
            asked = _INSTRUCTIONS.get(task) or "; ".join(arguments["tasks_to_complete"])
            yield f"### {task}\n\n{asked[0].upper()}{asked[1:]}. `{record.task_ids[task]}`"
            yield f"![{asked}](pictures/{picture})"


GALLERY_TABLES = {"gallery": lambda: "\n".join(f"## {domain}\n\n{gallery(domain)}" for domain in suite.DOMAINS)}
