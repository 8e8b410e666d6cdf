"""Policies of Kitchen Suite as a model server of vla-eval, for the episodes of `vla_eval_kitchen`.

python -m vla_eval_kitchen_server --address=localhost:8000 --args.policy=trained
"""

import dataclasses
import functools
import json
import sys
from typing import Any

import dm_env
from vla_eval.model_servers.base import SessionContext
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import run_server
from vla_eval.specs import LANGUAGE, RAW, DimSpec
from vla_eval.types import Action, Observation
from vla_eval_kitchen import SUITE_OBSERVATION

from kitchen_suite import policies
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.spec import EnvironmentSpec, policy_generator
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import PICTURE_OPTIONS

# Arguments of environments that policies without pictures do not depend on.
_OF_PICTURES = {"obs_type", "render_quality", *PICTURE_OPTIONS}


class SuitePolicyServer(PredictModelServer):
    """Answers with the actions of a policy of the suite, which acts on its own observation without pictures.

    Random numbers of a policy depend on the seed of the episode, as in `kitchen-record`.
    """

    def __init__(self, policy: str = "trained", **kwargs: Any) -> None:
        """Finds the policy.

        Args:
          policy: name of a policy as of the suite's commands, such as `random`, `trained`, or
            `trained(file='policy.npz')`.
          **kwargs: of `PredictModelServer`.

        Raises:
          ValueError: the policy does not exist.
        """
        super().__init__(**kwargs)
        self._policy_of = policies.find(policy)
        self._policies: dict[str, policies.Policy] = {}

    async def on_episode_start(self, config: dict[str, Any], ctx: SessionContext) -> None:
        await super().on_episode_start(config, ctx)
        task = config["task"]
        if "environment" not in task:
            raise ValueError(f"the task {task.get('name')!r} is not of KitchenSuiteBenchmark")
        generator = policy_generator(task["seed"] + task["episode_idx"])
        environment = _environment(task["environment"])
        self._policies[ctx.session_id] = self._policy_of(environment, generator, row=ctx.session_id)

    async def on_episode_end(self, result: dict[str, Any], ctx: SessionContext) -> None:
        await super().on_episode_end(result, ctx)
        self._policies.pop(ctx.session_id, None)

    def predict(self, obs: Observation, ctx: SessionContext) -> Action:
        policy = self._policies[ctx.session_id]
        policies.instruct(policy, lambda: obs["task_description"])
        step_type = dm_env.StepType.FIRST if ctx.is_first else dm_env.StepType.MID
        return {"actions": policy(dm_env.TimeStep(step_type, None, None, obs[SUITE_OBSERVATION]))}

    def get_observation_params(self) -> dict[str, Any]:
        return {SUITE_OBSERVATION: True}

    def get_action_spec(self) -> dict[str, DimSpec]:
        return {"actions": RAW}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        return {"language": LANGUAGE}


@functools.lru_cache(maxsize=8)
def _environment(spec: str) -> Environment:
    """Returns the environment, of which policies read the spaces, for the JSON of an `EnvironmentSpec`."""
    given = EnvironmentSpec(**json.loads(spec))
    task_kwargs = {name: value for name, value in given.task_kwargs.items() if name not in _OF_PICTURES}
    return suite_env(dataclasses.replace(given, task_kwargs=task_kwargs).make_environment(visuals=False)).environment


if __name__ == "__main__":
    try:
        run_server(SuitePolicyServer)
    except (ImportError, ValueError) as error:
        sys.exit(f"vla_eval_kitchen_server: {error}")
