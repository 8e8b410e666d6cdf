"""Metrics, completions and starts of the kitchen's episodes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.tasks.kitchen.observation import ROUNDING
from kitchen_suite.tasks.orders import REQUESTED
from kitchen_suite.tasks.records import Completions, Metrics, Records
from kitchen_suite.types import Array


class KitchenRecords(Records):
    """Reads the records of a kitchen task's episodes, which can also be replayed from their observations."""

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether all requested tasks were completed, and the control step of each completion."""
        completions = self.completions(infos)
        steps = self._task.mdp.goals.by_completion(completions.steps)
        return {"success": len(steps) == int(completions.requested.sum()), "tasks_completed": steps}

    def progress(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return infos["episode_task_completions_mask"].sum(axis=-1)

    def completions(self, infos: Mapping[str, Any]) -> Completions:
        tasks = self._task.mdp.goals.tasks
        return Completions(tasks, infos.get(f"{REQUESTED}_mask", np.full(len(tasks), True)), infos["completion_steps"])

    def goals_reached(self, arrays: Mapping[str, NDArray]) -> tuple[tuple[str, ...], NDArray[np.bool_]] | None:
        success, goals = self._task.mdp.success, self._task.mdp.goals
        keys = [f"observation/achieved_goal/{task}" for task in goals.tasks]
        achieved = arrays.get("observation/achieved_goal")
        if arrays.keys() >= {*keys}:
            achieved = np.concatenate([arrays[key] for key in keys], axis=1)
        if achieved is not None:
            within: NDArray[np.bool_] | None = success.within(achieved)
        else:
            distances = arrays.get("info/task_distances")
            within = None if distances is None else success.within_distances(distances)
        if within is None:
            return None
        requested = arrays.get(f"info/{REQUESTED}_mask", arrays.get(f"observation/{REQUESTED}"))
        return goals.tasks, within if requested is None else within & (requested > 0)

    def is_initial(self, physics: mjcf.Physics, observation: Array) -> bool:
        task = self._task
        present = task.mdp.clean_observation(task.simulation, task.state)
        greatest = task.episode.scaled(task.mdp.noise_scale)
        return bool((np.abs(observation - present) <= greatest + ROUNDING).all())

    def restore(self, physics: mjcf.Physics, observation: Array) -> None:
        task, sensors = self._task, self._task.mdp.sensors
        sensors.indices.write(physics, observation)
        sensors.refresh(physics)
        reading = sensors.read(task.simulation)
        task.set_mdp_state(
            task.state._replace(
                positions=reading.positions,
                target=task.robot.holding_targets(reading.positions),
                achieved=reading.achieved,
                distances=task.mdp.goals.distances(reading.achieved),
                shaping=task.mdp.start_shaping(reading),
            )
        )
        task.start_command(physics)

    def set_observed_positions(self, observation: Array) -> None:
        state = self._task.state
        noise = state.noise.copy()
        robot = self._task.mdp.sensors.slices.robot_positions
        noise[robot] = observation[robot] - state.positions
        self._task.set_mdp_state(state._replace(noise=noise))
