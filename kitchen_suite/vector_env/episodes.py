"""Many episodes of one task, stepped in one call of MuJoCo's batched stepping."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np
import tree
from numpy.typing import NDArray

from kitchen_suite.environment import INTEGRATION_STATE, Environment
from kitchen_suite.environment.physics_state import moving_elements
from kitchen_suite.environment.seeds import EpisodeSeeds
from kitchen_suite.environment.snapshots import ModelSnapshot, read_field, write_field
from kitchen_suite.tasks.episode.draws import BatchDraws
from kitchen_suite.tasks.episode.part import EpisodePart, MeasuringPart
from kitchen_suite.tasks.episode.pushes import Pushes
from kitchen_suite.tasks.episode.runner import EpisodeRunner
from kitchen_suite.tasks.episode.state import EpisodeState
from kitchen_suite.tasks.requests import Reset
from kitchen_suite.tasks.variations.variations import SLEEP
from kitchen_suite.vector_env import infos as info_arrays
from kitchen_suite.vector_env.batches import JoinedPusher, JoinedSensors, StateCopies, make_simulations


class Stream:
    """The random stream of one environment, drawn from by Gymnasium and by composer.

    Attributes:
      generator: Gymnasium's generator for the seed.
      seed: the seed; drawn by Gymnasium when `None` is passed.
      random_state: a RandomState over the generator's bit generator.
      has_episode: whether an episode has started with it.
    """

    def __init__(self, seed: int | None) -> None:
        """Starts the stream."""
        self.generator, self.seed = gymnasium.utils.seeding.np_random(seed)
        self.random_state = np.random.RandomState(self.generator.bit_generator)
        self.has_episode = False


class BatchEpisodes:
    """Episodes in a batch of simulations, each equal to its environment's own with the same random stream.

    An environment starts every episode; its state is then copied to the batch.

    Attributes:
      batch: the simulations.
      simulation: access to their fields; arrays with a leading axis `(n,)`.
      state: states of the episodes; arrays with a leading axis `(n,)`.
      streams: random streams of the episodes.
      steps: `(n,)`, control steps of the episodes.
      has_moved: `(n,)`, whether an episode has been started or stepped since a reader of this set it to False.
    """

    def __init__(
        self,
        environments: Sequence[Environment],
        threads: int,
        seeds: EpisodeSeeds,
    ) -> None:
        """Builds the simulations; `start` starts the episodes.

        Args:
          environments: the single environment that starts each of the `n` episodes, the same for many; their models are
            compiled, and their tasks differ in what is part of states and sensors alone. Nothing else may step them.
          threads: number of threads that step the episodes, including the calling one.
          seeds: how the seed of an episode follows from that of the one before it in the same environment.
        """
        self._seeds = seeds
        count = len(environments)
        distinct = [*dict.fromkeys(environments)]
        _check_robots(distinct)
        self._environments = environments
        self._task = distinct[0].task
        self._mdp = self._task.mdp
        self._physics_steps = self._task.physics_steps_per_control_step
        sensors = _joined([each.task.mdp.sensors for each in distinct])
        parts = {name: _joined([each.task.parts[name] for each in distinct]) for name in self._task.parts}
        stages = [sensors.stage, self._mdp.action_mode.stage, *(part.stage for part in parts.values())]
        stage = max(stages, key=int)
        self._stage = int(stage)
        models = [each.physics.model.ptr for each in environments]
        self._moving = [moving_elements(model) for model in models]
        self.batch, self.simulation = make_simulations([each.physics for each in environments], threads, stage)
        self._last_states = StateCopies(self.batch)
        self._runner = EpisodeRunner(self._mdp, self.simulation, sensors, parts)
        randomizer = self._task.variations.randomizer
        self._model_fields: dict[str, Any] = {name: self.batch.expand(name) for name in randomizer.model_fields}
        for name in randomizer.visual_fields:
            self._model_fields[name] = [read_field(model, name) for model in models]
        self._snapshots = {each: ModelSnapshot(each.physics.model.ptr) for each in distinct}
        self.streams = [Stream(None) for _ in range(count)]
        self.state: EpisodeState = self._task.episode.repeated(count)
        self._masked_variation_info: dict[str, Any] | None = None
        self._resets: dict[int, Reset] = {}
        self.steps = np.zeros(count, np.int64)
        self.has_moved = np.full(count, True)
        self._draws = BatchDraws(self.streams, self._mdp.noise_draws)

    def seed(self, seeds: Mapping[int, int]) -> None:
        """Starts random streams anew, by index of the episode."""
        for i, seed in seeds.items():
            self.streams[i] = Stream(seed)

    def reset_statistics(self, mask: NDArray[np.bool_] | None, total_steps: int) -> None:
        """Resets the statistics over episodes where the mask `(n,)` is True, or everywhere."""
        for name in self._mdp.persistent:
            getattr(self.state.mdp_state, name)[slice(None) if mask is None else mask] = total_steps

    def follow(self, resets: Mapping[int, Reset]) -> None:
        """Makes the next start of episodes, by index, follow what `checked_reset` of their tasks returned."""
        self._resets = dict(resets)

    def follow_edits(self) -> None:
        """Makes the simulations take what a user has changed in the models of their environments since the last call.

        Raises a RuntimeError if the MJCF of an environment has been edited, which simulations cannot take.
        """
        for environment, snapshot in self._snapshots.items():
            if environment.mjcf_has_changed():
                raise RuntimeError(
                    "the MJCF of the scene has been edited after the environments were built, which has no effect on "
                    "them: edit it in the function that builds the scene or in the constructor of the task, or change "
                    "template_env.environment.physics.model instead"
                )
            model = environment.physics.model.ptr
            edited = self._unknown_changes(snapshot)
            for name in edited:
                values = self.batch.expand(name)
                for i, each in enumerate(self._environments):
                    if each is environment:
                        values[i] = read_field(model, name)
            if edited:
                snapshot.update()

    def _expand_written_fields(self, environment: Environment) -> None:
        """Gives simulations fields of their own that a reset has written for the first time, beside what varies."""
        for name in self._unknown_changes(self._snapshots[environment]):
            # No earlier reset has changed it: all simulations still have the value that their models were built with.
            self._model_fields[name] = self.batch.expand(name)

    def _unknown_changes(self, snapshot: ModelSnapshot) -> list[str]:
        """Returns the fields that differ from a snapshot, beside those that every simulation has for itself."""
        return [name for name in snapshot.changed() if name not in self._model_fields]

    def start(self, mask: NDArray[np.bool_]) -> None:
        """Starts episodes where the mask `(n,)` is True."""
        (indices,) = mask.nonzero()
        if not indices.size:
            return
        self._masked_variation_info = None
        self.batch.reset(indices, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        kept = {name: getattr(self.state.mdp_state, name)[indices] for name in self._mdp.persistent}
        arrays = self.state.arrays()
        for i in indices.tolist():
            environment = self._environments[i]
            environment.random_state, task = self._stream_of_next(i).random_state, environment.task
            if i in self._resets:
                task.follow(self._resets.pop(i))
            environment.start_episode()
            if environment.starts_with_own_code:
                # It may have written fields of the model that no table names; looking for them takes a while.
                self._expand_written_fields(environment)
            model, data = environment.physics.model.ptr, environment.physics.data.ptr
            mujoco.mj_getState(model, data, self.batch.state[i], INTEGRATION_STATE)
            for name, values in self._model_fields.items():
                values[i] = read_field(model, name)
            for rows, started in zip(arrays, task.episode.arrays(), strict=True):
                if started is not None:
                    rows[i] = started
        for name, values in kept.items():
            getattr(self.state.mdp_state, name)[indices] = values
        self.steps[mask] = 0
        self.has_moved |= mask
        if self._task.variations.moves_sleepers:
            self._place_fixed_bodies(indices)
        if self._mdp.action_mode.reads_derived:
            self.batch.forward(indices, self._stage)
        self._last_states.update()

    def _stream_of_next(self, i: int) -> Stream:
        """Returns the random stream of the next episode of environment `i`."""
        if self._seeds and self.streams[i].has_episode:
            self.streams[i] = Stream(self._seeds.after(self.streams[i].seed))
        self.streams[i].has_episode = True
        return self.streams[i]

    def _place_fixed_bodies(self, indices: NDArray[np.int64]) -> None:
        """Computes the poses of all bodies in some simulations, as `Variations.place_fixed` does in one."""
        flags = self.batch.expand("opt.enableflags")
        kept = flags[indices]
        flags[indices] = kept & ~SLEEP
        self.batch.forward(indices, int(mujoco.mjtStage.mjSTAGE_POS))
        flags[indices] = kept

    def step(
        self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Makes a control step.

        A simulation that diverges returns to the end of the control step before: its episode is then what it was there.

        Args:
          actions: `(n, k)`, as they are applied.
          stepping: `(n,)`, episodes that make the step; the others are not simulated, and have to be started again.

        Returns:
          Rewards, terminations, and which simulations diverged, each `(n,)`; 0 and False where not `stepping`.
        """
        mdp = self._mdp
        self._draws.rows = stepping
        acting = self._runner.act(self.state, actions, self._draws)
        self.batch.step(None if stepping.all() else stepping, self._physics_steps, self._stage)
        diverged = np.logical_or.reduce(self.batch.warning[:, :, 1], axis=1) & stepping
        alive = stepping & ~diverged
        any_diverged = diverged.any()
        if any_diverged:
            self._last_states.restore(diverged)
            self.batch.forward(diverged, self._stage)
        self._draws.rows = alive
        before = self.state
        after = self._runner.advance(before, acting, self._draws)
        if any_diverged:
            after = after.keep_rows(before, diverged)
        self.state = after if alive.all() else after.keep_fields(mdp.persistent, before.mdp_state, ~alive)
        self._last_states.update()
        self.steps += alive
        self.has_moved |= alive
        rewards = np.where(alive, mdp.reward(after.mdp_state), 0.0)
        return rewards, (self._runner.terminates(after) & alive) | diverged, diverged

    def observation(self) -> NDArray:
        """Returns the flat observations `(n, m)` of all episodes, in a fresh array."""
        return self._runner.observation(self.state)

    def succeeds(self) -> NDArray[np.bool_]:
        """Returns in which episodes `(n,)` all that is asked for holds now, in a fresh array."""
        return np.array(self._runner.succeeds(self.state))

    def physics_state(self) -> tuple[NDArray[np.float64], ...]:
        """Returns qpos, qvel and act of each simulation, in fresh arrays."""
        return tuple(state[moving].copy() for state, moving in zip(self.batch.state, self._moving, strict=True))

    def info(self) -> dict[str, Any]:
        """Returns the infos of MDP and parts, and `episode_step`, the number of steps: `(n, ...)`."""
        return {
            **self._runner.mdp_info(self.state),
            **self._runner.info(self.state),
            "episode_step": self.steps.copy(),
        }

    def variation_info(self) -> dict[str, Any]:
        """Returns the infos on variation, physics and control step: fresh arrays `(n, ...)`, and dicts of these."""
        physics = self._task.scene.info.items()
        named = {name: np.full(self.steps.shape, value, object) for name, value in physics}
        changed = self._environments[0].changed_timestep.items()
        timestep = {name: np.full(self.steps.shape, value) for name, value in changed}
        return {**info_arrays.copied(self.state.variation), **named, **timestep}

    def masked_variation_info(self) -> dict[str, Any]:
        """Returns the infos on variation and physics beside masks that are True everywhere, in read-only arrays.

        Arrays are the same until episodes start, which leaves them as they are; the dicts are fresh.
        """
        if self._masked_variation_info is None:
            infos = info_arrays.with_masks(self.variation_info(), np.full(self.steps.shape, True))
            for array in tree.flatten(infos):
                array.flags.writeable = False
            self._masked_variation_info = infos
        return info_arrays.fresh_dicts(self._masked_variation_info)

    def show(self, i: int) -> None:
        """Copies simulation `i` to its environment, to render it; the next `start` overwrites it."""
        environment = self._environments[i]
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        for name, values in self._model_fields.items():
            write_field(model, name, values[i])
        mujoco.mj_setState(model, data, self.batch.state[i], INTEGRATION_STATE)
        environment.task.variations.place_fixed()
        mujoco.mj_forward(model, data)


def _joined(readers: Sequence[Any]) -> Any:
    """Returns sensors, or parts, of one model as they are, and those of several as one that reads each by its own."""
    first = readers[0]
    if len(readers) == 1:
        return first
    if isinstance(first, MeasuringPart):
        return first.reading_by(JoinedSensors(readers))
    if isinstance(first, Pushes):
        return first.made_by(JoinedPusher([each.pusher for each in readers]))
    if not isinstance(first, EpisodePart):
        return JoinedSensors(readers)
    if not first.suits_any_model:
        raise ValueError(f"{type(first).__name__}, a part of episodes, does not suit environments of several models")
    return first


def _check_robots(environments: Sequence[Environment]) -> None:
    """Raises a ValueError unless the robots of different environments have the same indices in MuJoCo's arrays."""
    indices = []
    for environment in environments:
        physics, robot = environment.physics, environment.task.robot
        found = [physics.bind(robot.mjcf_model.find_all(kind)).element_id for kind in ("body", "site", "actuator")]
        joints = physics.bind(robot.joints)
        indices.append([array.tolist() for array in (*found, joints.element_id, joints.qposadr, joints.dofadr)])
    if any(each != indices[0] for each in indices):
        raise ValueError("the robot must be attached before anything that differs between environments of a vector")


class BatchPictures:
    """The pictures of many episodes, rendered one after the other by the environments that start them.

    An episode is rendered again only after it has moved.
    """

    def __init__(self, environments: Sequence[Environment], episodes: BatchEpisodes) -> None:
        """Prepares to show episodes in the environments that start them, which nothing else may step."""
        self._episodes = episodes
        count = len(environments)
        pictures = environments[0].task.pictures
        takers = {each: each.task.pictures.takers(each.physics) for each in dict.fromkeys(environments)}
        self._takers = [takers[each] for each in environments]
        specs = {key: taker.array_spec for key, taker in pictures.by_name.items()}
        self._present = {key: np.zeros((count, *spec.shape), spec.dtype) for key, spec in specs.items()}

    def take(self) -> dict[str, NDArray]:
        """Returns the present pictures `(n, height, width, channels)` by observation key, in fresh arrays."""
        if not self._present:
            return {}
        moved = self._episodes.has_moved
        for i in np.flatnonzero(moved).tolist():
            self._episodes.show(i)
            for key, take in self._takers[i].items():
                self._present[key][i] = take()
        moved[:] = False
        return {key: array.copy() for key, array in self._present.items()}
