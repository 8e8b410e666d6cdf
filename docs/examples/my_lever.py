"""A custom object with a joint: a lever on the counter, observed and rewarded. Run: python my_lever.py."""

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.tasks import KitchenTask, Observation

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control import composer, mjcf

PLACE = (-0.65, -0.35, 1.61)  # Of the lever's base on the counter, on the robot's left [m].


class Lever(composer.Entity):
    """A lever of 0.2 kg that stands upright; it falls to either side, and a spring brings it back."""

    def _build(self):
        self._model = mjcf.RootElement(model="lever")
        self._model.worldbody.add("geom", type="box", size=(0.04, 0.04, 0.01), rgba=(0.3, 0.3, 0.3, 1))
        arm = self._model.worldbody.add("body", name="arm", pos=(0, 0, 0.02))
        arm.add("joint", name="hinge", axis=(0, 1, 0), range=(-1.2, 1.2), stiffness=0.5, damping=0.05)
        arm.add("geom", type="capsule", size=(0.012,), fromto=(0, 0, 0, 0, 0, 0.15), mass=0.2, rgba=(0.8, 0.5, 0, 1))

    @property
    def mjcf_model(self):
        return self._model


def angle(simulation, state):
    """Returns the lever's angle [rad], for one episode or for many."""
    return simulation.named("qpos", "lever/hinge")


def velocity(simulation, state):
    """Returns the velocity of this angle [rad/s]."""
    return simulation.named("qvel", "lever/hinge")


def pushed(step):
    """A reward of 1 for each radian that the lever is out of the vertical."""
    return np.abs(step.observations["lever_angle"][..., 0])


def over(step):
    """Whether the lever is 1 rad or more out of the vertical: success."""
    return pushed(step) >= 1.0


class LeverTask(KitchenTask):
    """Push over a lever on the kitchen's counter."""

    instructions = ("push the lever over",)

    extra_observations = {"lever_angle": Observation(angle), "lever_velocity": Observation(velocity)}
    extra_rewards = {"pushed": pushed}
    extra_successes = {"over": over}

    def __init__(self, scene, **options):
        scene.attach(Lever(), pos=PLACE)
        super().__init__(scene, **options)

    def reset_physics(self, physics, random_state):
        super().reset_physics(physics, random_state)
        physics.named.data.qpos["lever/hinge"] = random_state.uniform(-0.3, 0.3)


LEVER_KITCHEN = suite.Domain(
    "lever_kitchen",
    scene=build_kitchen_scene,
    task=LeverTask,
    tasks={"push": {}},
    env_id="Mine/LeverKitchen-v1",
    episode_steps=280,
)

if __name__ == "__main__":
    suite.register(LEVER_KITCHEN)
    environment = suite.load("lever_kitchen", "push", {"random": 0})
    print("angle [rad]:", environment.reset().observation["lever_angle"])
    print("dm_control:", environment.step(np.zeros(9)).reward)
    env = gymnasium.make("Mine/LeverKitchen-v1")
    env.reset(seed=0)
    print("single:", env.step(np.zeros(9))[1])
    envs = gymnasium.make_vec("Mine/LeverKitchen-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.zeros((4, 9)))[1])
