"""Evaluations without playing, whose results are those that a test names."""

import functools

from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.plan import Replaced, make_plan, make_unprepared_plan
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.policies import PolicyRef

EPISODES = 6
TASKS = ("kettle", "microwave")


@functools.cache
def plan_of(policy="zero", protocol="default", **replaced):
    values = {"num_episodes": EPISODES, **replaced}
    values["task_kwargs"] = dict(values.get("task_kwargs", ()))
    return make_plan(PolicyRef.parse(policy), protocol, Replaced(**values))


def evaluated(completed=((), ("kettle",), TASKS, TASKS, TASKS, TASKS), **arguments):
    """An evaluation without playing: of each condition as many episodes, with the tasks that each completed."""
    plan = plan_of(**arguments)
    results = {
        name: [
            EpisodeResult(
                condition=name,
                episode=index,
                seed=plan.first.seed + index,
                success=len(tasks) == len(TASKS),
                progress=len(tasks) / len(TASKS),
                control_steps=100,
                asked={task: 10 if task in tasks else None for task in TASKS},
            )
            for index, tasks in enumerate(completed[: plan.num_episodes])
        ]
        for name in plan.specs
    }
    return Evaluation(plan=plan, results=results)


def kitchens(completed, policy="zero"):
    """Evaluation of generated kitchens, without playing: the successes of the four episodes of the first ones."""
    plan = make_unprepared_plan(PolicyRef.parse(policy), "unseen-kitchens", Replaced(domain_name="kitchens"))
    results = {name: [] for name in plan.specs}
    for place, name in enumerate(plan.specs):
        for index in range(plan.num_episodes):
            success = place < len(completed) and index < completed[place]
            results[name].append(
                EpisodeResult(
                    condition=name,
                    episode=index,
                    seed=plan.first.seed + index,
                    success=success,
                    progress=float(success),
                    control_steps=100,
                    asked={"door": 10 if success else None},
                )
            )
    return Evaluation(plan=plan, results=results)
