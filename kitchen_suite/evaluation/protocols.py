"""The protocols of `kitchen-evaluate`: the values that each fixes, and its source.

This module imports no dm_control, so that the command's help can show them. Results are quoted by the name of their
protocol, so the numbers of a protocol must not change once results under it have been published.
"""

import dataclasses
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

from kitchen_suite import suite

# Training takes its seeds from 500,000,000 on, and recordings usually from 0: between them nothing has been trained on.
UNSEEN_SEED = 400_000_000

# First seed of Diffusion Policy's test episodes.
DIFFUSION_POLICY_SEED = 100_000

# The groups of variations of the protocol `shift`, each varied alone, and all together; fixed here, so that a further
# group does not change the protocol.
SHIFT_GROUPS = ("start", "layout", "dynamics", "sensing", "appearance", "camera")

# Control steps of an episode of FrankaKitchen-v1 and of the publications on it.
KITCHEN_STEPS = 280

# Control steps for strict success, which takes the expert about twice as long.
STRICT_STEPS = 400


@dataclasses.dataclass(frozen=True, kw_only=True)
class Condition:
    """Episodes that are scored together.

    Attributes:
      name: in results; the name of the task when empty.
      task_name: one of the domain's tasks; that of its `DomainProtocols` when None.
      task_kwargs: arguments of the Gymnasium environment.
    """

    name: str = ""
    task_name: str | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Score:
    """A published score: the mean number of completed tasks in another unit.

    Attributes:
      name: its key in results.
      best: its value where all tasks are completed.
      tasks: number of these tasks.
    """

    name: str
    best: float
    tasks: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Protocol:
    """A way to evaluate a policy.

    Attributes:
      name: value of the flag `--protocol`.
      follows: its source, and the values that it fixes, in a few words.
      conditions: of its episodes; each is played from the same seeds.
      seed: of the first episode of a condition; the others have the next ones.
      num_episodes: of each condition.
      max_episode_steps: control steps of an episode; the domain's when None.
      is_general: whether it is for every domain; otherwise for those that name it among their `protocols`.
      score: a published score; None if there is none.
    """

    name: str
    follows: str
    conditions: tuple[Condition, ...]
    seed: int = UNSEEN_SEED
    num_episodes: int
    max_episode_steps: int | None = None
    is_general: bool = False
    score: Score | None = None


# Conditions of `shift`: nothing varied, each group alone, all groups, seen and held-out; and pushes.
_SHIFTS = (
    Condition(name="none"),
    *(
        Condition(name=f"{name} {split}", task_kwargs={"variations": groups, "variation_split": split})
        for name, groups in {**{group: [group] for group in SHIFT_GROUPS}, "all": [*SHIFT_GROUPS]}.items()
        for split in ("seen", "held_out")
    ),
    Condition(name="push", task_kwargs={"variations": ["push"]}),
)


_PROTOCOLS = (
    Protocol(
        name="default",
        follows="the suite's own: random 4 of the 7 tasks (kitchen), varied starts, seeds that training never uses",
        conditions=(Condition(task_kwargs={"variations": ["start"]}),),
        num_episodes=200,
        is_general=True,
    ),
    Protocol(
        name="strict",
        follows="as default, with strict success: joints within 0.05 rad or 1 cm, the kettle 3 cm; 400 control steps",
        conditions=(Condition(task_kwargs={"variations": ["start"], "success": "strict"}),),
        num_episodes=200,
        max_episode_steps=STRICT_STEPS,
    ),
    Protocol(
        name="diffusion-policy",
        follows="Chi et al. 2023, by their code: all 7 tasks count, noise 0.1, position actions; score: mean tasks / 7",
        conditions=(
            Condition(
                task_name="all",
                # Their code scales the noise of robot and objects by its one `robot_noise_ratio`.
                task_kwargs={
                    "control_mode": "joint_position",
                    "robot_noise_ratio": 0.1,
                    "object_noise_ratio": 0.1,
                },
            ),
        ),
        seed=DIFFUSION_POLICY_SEED,
        num_episodes=50,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="score", best=1.0, tasks=7),
    ),
    Protocol(
        name="d4rl",
        follows="Fu et al. 2020: the sets complete, partial and mixed, velocity actions; score: mean tasks / 4 x 100",
        conditions=tuple(
            Condition(task_name=task, task_kwargs={"control_mode": "joint_velocity"})
            for task in ("complete", "partial", "mixed")
        ),
        num_episodes=100,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="d4rl_score", best=100.0, tasks=4),
    ),
    Protocol(
        name="beso",
        follows="Reuss et al. 2023: random 4 of 7 tasks, which the policy is shown; 100 episodes for each of 10 seeds",
        conditions=(Condition(task_name="random_4", task_kwargs={"control_mode": "joint_velocity"}),),
        num_episodes=1_000,
        max_episode_steps=KITCHEN_STEPS,
    ),
    Protocol(
        name="shift",
        follows="zero-shot, as kitchen-shift 2021: nothing varied, each group, all; seen and held-out; and pushes",
        conditions=_SHIFTS,
        num_episodes=100,
        is_general=True,
    ),
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType({protocol.name: protocol for protocol in _PROTOCOLS})


@dataclasses.dataclass(frozen=True, kw_only=True)
class DomainProtocols:
    """The evaluation of a domain, as far as it is its own.

    Attributes:
      task_name: task that is played where a protocol names none; the domain's default task when None.
      protocols: names of the protocols that are made for this domain, beside those for all.
    """

    task_name: str | None = None
    protocols: Collection[str] = ()


def domain_protocols(domain_name: str) -> DomainProtocols:
    """Returns the evaluation of a domain."""
    return suite.find_domain(domain_name).resolve("evaluation") or DomainProtocols()


KITCHEN = DomainProtocols(
    task_name="random_4", protocols=tuple(protocol.name for protocol in _PROTOCOLS if not protocol.is_general)
)
