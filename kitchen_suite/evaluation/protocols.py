"""The protocols of `kitchen-evaluate`: the values that each fixes, and its source.

This module imports no dm_control, so that the command's help can show them. Results are quoted by the name of their
protocol, so the numbers of a protocol must not change once results under it have been published.
"""

import dataclasses
import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.evaluation import criteria

# Training takes its seeds from 500,000,000 on, and recordings usually from 0: between them nothing has been trained on.
UNSEEN_SEED = 400_000_000

# The groups of variations of the protocol `shift`, each varied alone, and all together; fixed here, so that a further
# group does not change the protocol.
SHIFT_GROUPS = ("start", "layout", "dynamics", "sensing", "appearance", "camera")

# What counts as one observation, where conditions are no sample.
EPISODE = "episode"

# Control steps of an episode of FrankaKitchen-v1 and of the publications on it.
KITCHEN_STEPS = 280

# What an episode is measured by: a function of the states `(T + 1, 30)` of `criteria`, from the reset on, and of the
# goal states `(k, 30)` of its reset.
Measure = Callable[[NDArray[np.float64], NDArray[np.float64]], bool | float]

# What an episode asks for: options of its reset, given the states `(T + 1, 30)` of a recorded episode, the tasks that
# it completed, and a generator to draw from; None where that episode has no goal.
Goals = Callable[[NDArray[np.float64], Sequence[str], np.random.Generator], dict[str, Any] | None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Condition:
    """Episodes that are scored together, in Gymnasium environments with arguments `task_kwargs`.

    Attributes:
      name: in results; the name of the task when empty.
      task_name: one of the domain's tasks; that of its `DomainProtocols` when None.
      measures: further measures of its episodes by name; only in the kitchen.
      goals: what its episodes ask for, taken from a recording; None where their seeds say it all.
      goal_options: names of the options of a reset that `goals` returns.
    """

    name: str = ""
    task_name: str | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    measures: Mapping[str, Measure] = dataclasses.field(default_factory=dict)
    goals: Goals | None = None
    goal_options: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Score:
    """A published score: the mean number of completed tasks in another unit, `best` where all `tasks` are completed."""

    name: str
    best: float
    tasks: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Protocol:
    """A way to evaluate a policy, by its name.

    Attributes:
      follows: its source, and the values that it fixes, in a few words.
      conditions: of its episodes; each is played from the same seeds.
      seed: of the first episode of a condition; the others have the next ones.
      num_episodes: of each condition.
      max_episode_steps: control steps of an episode; the domain's when None.
      domain_name: the domain that it is for, beside those that name it among their `protocols`; None for every domain.
      score: a published unit of the mean number of completed tasks, if there is one.
      overall: the protocol's scores over all conditions, from the scores by condition; of its score and of measures of
        its conditions, which are left out where an evaluation replaces what they depend on.
      sampled: its scores, as means over all conditions, where these are a sample of many more, as kitchens are; empty
        where each condition has scores of its own.
      unit: what counts as one observation: an episode, or what each of the sampled conditions is, such as a kitchen.
      has_control: whether the first condition is the control arm, with which the others are compared in pairs.
      differences: what is not as in the source, in a sentence; empty if nothing is known to be.
    """

    name: str
    follows: str
    conditions: tuple[Condition, ...]
    seed: int = UNSEEN_SEED
    num_episodes: int
    max_episode_steps: int | None = None
    domain_name: str | None = "kitchen"
    score: Score | None = None
    overall: Callable[[Mapping[str, Mapping[str, Any]]], dict[str, float]] = lambda scores: {}
    sampled: tuple[str, ...] = ()
    unit: str = EPISODE
    has_control: bool = False
    differences: str = ""


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


# The noise of D4RL's kitchen, ten times and two hundred times that of FrankaKitchen-v1.
_NOISE = {"robot_noise_ratio": 0.1, "object_noise_ratio": 0.1}

# Generated kitchens in which nothing is trained, and the episodes in each.
UNSEEN_KITCHENS, UNSEEN_EPISODES = 100, 4

# Without noise, and to the last control step, as environments of goals that are reached or not.
_EXACTLY_SEEN = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0, "terminate_on_tasks_completed": False}


def _velocity_conditions(*tasks: str, **task_kwargs: Any) -> tuple[Condition, ...]:
    """Returns the conditions of tasks whose actions are joint velocities, with further arguments."""
    return tuple(
        Condition(task_name=task, task_kwargs={"control_mode": "joint_velocity", **task_kwargs}) for task in tasks
    )


def _means(scores: Mapping[str, Mapping[str, Any]], names: Collection[str]) -> dict[str, float]:
    return {name: round(sum(score[name] for score in scores.values()) / len(scores), 6) for name in names}


def _ordered(name: str, task_name: str, source: str, tasks: Sequence[str] | None = None) -> Protocol:
    """Returns a protocol of tasks that count in their order."""
    kwargs = {"control_mode": "joint_velocity", **_NOISE, "tasks_in_order": True}
    chosen = {} if tasks is None else {"tasks_to_complete": [*tasks]}
    return Protocol(
        name=name,
        follows=f"{source}, in order, noise 0.1, velocities; score: mean tasks",
        conditions=(Condition(name=name, task_name=task_name, task_kwargs={**kwargs, **chosen}),),
        num_episodes=100,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="subtasks", best=4.0, tasks=4),
        differences="Observations also have velocities; distances are of true positions.",
    )


def _kitchen_condition(design: int) -> Condition:
    """Returns a condition of a generated kitchen: to open one of the parts that the expert is certified to open."""
    return Condition(
        name=f"kitchen {design}",
        task_name="open",
        task_kwargs={
            "design": design,
            "split": "test",
            "certified": True,
            "num_slots": 1,
            "control_mode": "ee_delta_pose",
            "physics": "fast",
        },
    )


def _object_condition(design: int) -> Condition:
    """Returns a condition of a kitchen with objects: one of the tasks that the expert is certified to complete."""
    return Condition(
        name=f"kitchen {design}",
        task_name="any",
        task_kwargs={
            "design": design,
            "split": "test",
            "certified": True,
            "num_slots": 2,
            "control_mode": "ee_delta_pose",
            "physics": "fast",
        },
    )


_PROTOCOLS = (
    Protocol(
        name="default",
        follows="the suite's own: random 4 of the 7 tasks (kitchen), varied starts, seeds that training never uses",
        conditions=(Condition(task_kwargs={"variations": ["start"]}),),
        num_episodes=200,
        domain_name=None,
    ),
    Protocol(
        name="strict",
        follows="as default, with strict success: joints within 0.05 rad or 1 cm, the kettle 3 cm; 400 control steps",
        conditions=(Condition(task_kwargs={"variations": ["start"], "success": "strict"}),),
        num_episodes=200,
        # The expert takes about twice as long.
        max_episode_steps=400,
    ),
    Protocol(
        name="clean",
        follows="as default; score: clean success, with nothing else disturbed, and no more than 10 N on the bare arm",
        conditions=(Condition(task_kwargs={"variations": ["start"], "quality": True}),),
        num_episodes=200,
        domain_name=None,
    ),
    Protocol(
        name="diffusion-policy",
        follows="Chi et al. 2023, by their code: all 7 tasks count, noise 0.1, position actions; score: mean tasks / 7",
        # Their code scales the noise of robot and objects by its one `robot_noise_ratio`.
        conditions=(Condition(task_name="all", task_kwargs={"control_mode": "joint_position", **_NOISE}),),
        # Of their test episodes.
        seed=100_000,
        num_episodes=50,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="score", best=1.0, tasks=7),
    ),
    Protocol(
        name="d4rl",
        follows="Fu et al. 2020: the sets complete, partial and mixed, velocity actions; score: mean tasks / 4 x 100",
        conditions=_velocity_conditions("complete", "partial", "mixed"),
        num_episodes=100,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="d4rl_score", best=100.0, tasks=4),
        differences=(
            "The noise is that of FrankaKitchen-v1: a tenth of D4RL's on the robot, and a two-hundredth on objects. "
            "For D4RL's noise, replace both ratios by 0.1, as `hiql` and `dppo` have them. Observations also have "
            "velocities; distances are of true positions."
        ),
    ),
    *(
        Protocol(
            name=name,
            follows=f"{source}: D4RL's {' and '.join(tasks)}, noise 0.1, velocities; score: mean tasks / 4 x 100",
            conditions=_velocity_conditions(*tasks, **_NOISE),
            num_episodes=50,
            max_episode_steps=KITCHEN_STEPS,
            score=Score(name="d4rl_score", best=100.0, tasks=4),
            differences=(
                "The policy observes the goals of the tasks, from which `kitchen_suite.evaluation.criteria.goal_state` "
                "makes the goal of 30 numbers; distances are of true positions."
            ),
        )
        for name, source, tasks in (
            ("hiql", "Park et al. 2023", ("partial", "mixed")),
            ("gas", "Baek et al. 2025", ("partial",)),
        )
    ),
    Protocol(
        name="dppo",
        follows="Ren et al. 2024: D4RL's three sets, noise 0.1, velocities, 40 environments; score: mean tasks / 4",
        conditions=_velocity_conditions("complete", "partial", "mixed", **_NOISE),
        num_episodes=40,
        max_episode_steps=KITCHEN_STEPS,
        score=Score(name="mean_reward", best=1.0, tasks=4),
        differences="Chunks of four actions are the policy's own; distances are of true positions.",
    ),
    _ordered("spirl", "mixed", "Pertsch et al. 2020, by their code: the tasks of D4RL's mixed"),
    _ordered(
        "skild",
        "all",
        "Pertsch et al. 2021: kettle, bottom and top burner, slide cabinet",
        ("kettle", "bottom burner", "top burner", "slide cabinet"),
    ),
    _ordered(
        "skimo",
        "all",
        "Shi et al. 2022: microwave, light, slide and hinge cabinet",
        ("microwave", "light switch", "slide cabinet", "hinge cabinet"),
    ),
    Protocol(
        name="random-4",
        follows="random 4 of 7 tasks, which the policy is shown, velocities; ten seeds of 100 episodes, as in BESO",
        conditions=_velocity_conditions("random_4"),
        num_episodes=1_000,
        max_episode_steps=KITCHEN_STEPS,
    ),
    Protocol(
        name="beso",
        follows="Reuss et al. 2023: the last two states of a demonstration are the goal, its tasks count; from data",
        conditions=(
            Condition(
                name="goals",
                task_name="all",
                task_kwargs={
                    "tasks_per_episode": [1, 7],
                    "goal_states": criteria.BESO_FRAMES,
                    "control_mode": "joint_velocity",
                },
                goals=criteria.last_frames,
                goal_options=("requested_tasks", "goal_states"),
            ),
        ),
        num_episodes=1_000,
        max_episode_steps=KITCHEN_STEPS,
        differences=(
            "The policy may also observe which tasks are meant, as our own do. The demonstrations are those of the "
            "given recording: BESO's are Relay Policy Learning's, which kitchen-convert reads."
        ),
    ),
    Protocol(
        name="goal-reaching",
        follows="as stable-worldmodel: from a recorded state to the one 30 control steps later, within 50; from data",
        conditions=(
            Condition(
                name="goals",
                task_name="all",
                task_kwargs={"goal_states": 1, "control_mode": "joint_velocity", **_EXACTLY_SEEN},
                measures={"goal_reached": criteria.goal_reached},
                goals=criteria.later_state,
                goal_options=("start_state", "goal_states"),
            ),
        ),
        num_episodes=100,
        max_episode_steps=criteria.GOAL_STEPS,
        overall=functools.partial(_means, names=("goal_reached",)),
        differences=(
            "stable-worldmodel leaves success to its environments: here all objects have to come within 0.1 of the "
            "goal, where they are not at the start. Episodes start at rest."
        ),
    ),
    Protocol(
        name="shift",
        follows="zero-shot, as kitchen-shift 2021: nothing varied, each group, all; seen and held-out; and pushes",
        conditions=_SHIFTS,
        num_episodes=100,
        domain_name=None,
        has_control=True,
    ),
    Protocol(
        name="unseen-kitchens",
        follows="the suite's own: one part to open, in 100 generated kitchens of `test`, fast physics; score: success",
        conditions=tuple(map(_kitchen_condition, range(UNSEEN_KITCHENS))),
        num_episodes=UNSEEN_EPISODES,
        domain_name="kitchens",
        sampled=("success",),
        unit="kitchen",
    ),
    Protocol(
        name="unseen-pick-and-place",
        follows="the suite's own: one object to put away, in 100 generated kitchens of `test`; score: success",
        conditions=tuple(map(_object_condition, range(UNSEEN_KITCHENS))),
        num_episodes=UNSEEN_EPISODES,
        domain_name="pick_and_place",
        sampled=("success",),
        unit="kitchen",
    ),
)

PROTOCOLS: Mapping[str, Protocol] = MappingProxyType({protocol.name: protocol for protocol in _PROTOCOLS})


@dataclasses.dataclass(frozen=True, kw_only=True)
class DomainProtocols:
    """The evaluation of a domain: the names of protocols that it takes beside those for all and those that name it.

    `task_name` is the task that is played where a protocol names none; the domain's default task when None.
    """

    task_name: str | None = None
    protocols: Collection[str] = ()


def domain_protocols(domain_name: str) -> DomainProtocols:
    """Returns the evaluation of a domain."""
    return suite.find_domain(domain_name).resolve("evaluation") or DomainProtocols()


def _names_of(domain_name: str) -> tuple[str, ...]:
    return tuple(protocol.name for protocol in _PROTOCOLS if protocol.domain_name == domain_name)


KITCHEN = DomainProtocols(task_name="random_4", protocols=_names_of("kitchen"))
