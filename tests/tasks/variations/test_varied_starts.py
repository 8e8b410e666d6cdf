"""Many varied starts: nothing stands in anything else, and physics stays finite under random actions."""

import gymnasium
import mujoco
import numpy as np
import pytest
from helpers.sweeps import brief, groups_of
from helpers.vectors import batch

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks.variations.distributions import SPLITS

# Depth beyond that of the default layout [m].
DEPTH = 0.005


class Depths:
    """Depths of all pairs of colliding geoms of different objects, measured one by one.

    Independent of `tasks.layouts`: it looks at every pair, also of planes, whatever their bounding boxes.
    """

    def __init__(self, physics):
        self._model = model = physics.model.ptr
        self._data = mujoco.MjData(model)
        geoms = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
        # The root of an object's bodies below the world; the robot's is the pedestal.
        roots = model.body_rootid[model.geom_bodyid]
        first, second = (geoms[indices] for indices in np.triu_indices(geoms.size, 1))
        planes = (model.geom_type[first] == 0) & (model.geom_type[second] == 0)
        chosen = (roots[first] != roots[second]) & ~planes
        self._pairs = np.stack([first[chosen], second[chosen]], axis=1)
        self._measure(physics, slice(None))
        self._default = self._poses(), self._measure(physics, slice(None))

    def _poses(self):
        return np.concatenate([self._data.geom_xpos, self._data.geom_xmat], axis=1)

    def _measure(self, physics, pairs):
        self._data.qpos[:] = physics.data.qpos
        mujoco.mj_kinematics(self._model, self._data)
        distances = [mujoco.mj_geomDistance(self._model, self._data, *pair, 0.001, None) for pair in self._pairs[pairs]]
        return np.maximum(-np.array(distances), 0.0)

    def excess(self, physics):
        """The greatest depth beyond the default's [m], and the names of the two geoms."""
        self._measure(physics, slice(0))
        poses, default = self._default
        moved = (self._poses() != poses).any(axis=1)
        # Where neither geom has moved, depths are the default ones.
        pairs = np.flatnonzero(moved[self._pairs].any(axis=1))
        beyond = self._measure(physics, pairs) - default[pairs]
        deepest = int(beyond.argmax())
        return beyond[deepest], [physics.model.id2name(i, "geom") for i in self._pairs[pairs[deepest]]]


def assert_free(domain, split, count):
    env = suite.DOMAINS[domain].env_class(variations=groups_of(domain), variation_split=split)
    env.reset(seed=0, options={"variation": []})
    physics = env.environment.physics
    # The drawn pose of the robot, where a domain draws it, is free space.
    depths = Depths(physics)
    env.reset(seed=1)
    for number in range(count):
        _, info = env.reset()
        assert env.environment.physics is physics
        excess, names = depths.excess(physics)
        assert excess <= DEPTH, (number, names, info["variation_values"])


@pytest.mark.full
def test_the_measure_sees_a_kettle_in_the_stove():
    env = FrankaKitchenEnv()
    env.reset(seed=0)
    physics = env.environment.physics
    depths = Depths(physics)
    scene = env.environment.task.scene
    physics.bind(scene.props["kettle"].joints).qpos[:3] += (0.0, 0.0, -0.03)
    excess, names = depths.excess(physics)
    assert 0.02 < excess < 0.04
    assert sum(name.startswith("kettle/") for name in names) == 1


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("domain", brief(suite.DOMAINS, ["microwave_table"], full=suite.DOMAINS))
def test_in_varied_starts_nothing_stands_in_anything_else(domain, split):
    assert_free(domain, split, 3)


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize(
    ("domain", "count"), [("kitchen", 1000), *((domain, 300) for domain in suite.DOMAINS if domain != "kitchen")]
)
def test_in_many_varied_starts_nothing_stands_in_anything_else(domain, split, count):
    assert_free(domain, split, count)


def assert_stays_finite(domain, split, steps, num_envs=16):
    """Random actions over episodes with all variations of a domain, with all warnings of MuJoCo counted."""
    env = gymnasium.make_vec(
        suite.DOMAINS[domain].env_id,
        num_envs,
        vectorization_mode="vector_entry_point",
        variations=groups_of(domain),
        variation_split=split,
        max_episode_steps=40,
        autoreset_mode="SameStep",
    )
    inner, generator = env.unwrapped, np.random.default_rng(0)
    scale = 1.0 if np.isfinite(env.action_space.high).all() else 0.05
    warned = np.zeros(batch(inner).warning.shape[1], int)
    env.reset(seed=0)
    episodes = 0
    for _ in range(steps // num_envs):
        observation, reward, terminated, truncated, info = env.step(
            generator.uniform(-scale, scale, env.action_space.shape)
        )
        parts = observation.values() if isinstance(observation, dict) else [observation]
        leaves = [leaf for part in parts for leaf in (part.values() if isinstance(part, dict) else [part])]
        assert all(np.isfinite(leaf).all() for leaf in leaves)
        assert np.isfinite(reward).all()
        assert "physics_error" not in info
        warned += batch(inner).warning[:, :, 1].sum(axis=0)
        episodes += int((terminated | truncated).sum())
    assert not warned.any(), warned
    # All episodes of 40 steps or fewer, but the last ones.
    assert episodes >= steps // 40 - num_envs
    env.close()


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_random_actions_in_varied_episodes_stay_finite(domain):
    assert_stays_finite(domain, "held_out", 640)


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_20_000_random_actions_in_varied_episodes_stay_finite(domain, split):
    assert_stays_finite(domain, split, 20_000)
