"""A custom object: a mug on the counter, observed, grasped, and seen by its own camera. Run: python mug.py."""

import gymnasium
import numpy as np

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.grasping import Grasp
from kitchen_suite.tasks import KitchenTask, Observation

# isort: split
# After the suite: imported first, dm_control would open a GL library at once.
from dm_control.composer.variation import distributions, noises
from dm_control.entities.props.primitive import Primitive

PLACE = (-0.6, 0.0, 1.651)  # Of the mug on the counter, on the robot's left [m].


def position(simulation, state):
    """Returns the mug's position in the world [m], for one episode or for many."""
    return simulation.named("xpos", "mug/")


def lifted(step):
    """A reward of 1 for each metre that the mug is above its place."""
    return step.observations["mug_position"][..., 2] - PLACE[2]


def dropped(step):
    """Ends the episode once the mug has fallen off the counter."""
    return step.observations["mug_position"][..., 2] < 1.4


def raised(step):
    """Whether the mug is 0.1 m above its place or higher: success."""
    return step.observations["mug_position"][..., 2] > PLACE[2] + 0.1


class MugTask(KitchenTask):
    """Lift a mug of 0.3 kg from the kitchen's counter; its position is observed with noise."""

    instructions = ("lift the mug",)

    extra_observations = {
        "mug_position": Observation(position, noise=noises.Additive(distributions.Uniform(-0.005, 0.005)))
    }
    extra_rewards = {"lifted": lifted}
    extra_terminations = {"dropped": dropped}
    extra_successes = {"raised": raised}

    def __init__(self, scene, **options):
        mug = Primitive(geom_type="cylinder", size=(0.035, 0.05), mass=0.3, rgba=(0.8, 0.2, 0.2, 1), name="mug")
        # Where the hand's end effector is when the fingers close, pointing down.
        mug.mjcf_model.worldbody.add("site", name="grasp", pos=(0, 0, 0.015), quat=(0, 1, 0, 0))
        scene.attach(mug, pos=PLACE, free=True)
        scene.arena.mjcf_model.worldbody.add("camera", name="mug", pos=(-0.5, -0.9, 2.3), xyaxes=(1, 0, 0, 0, 0.6, 0.8))
        super().__init__(scene, **options)


MUG_KITCHEN = suite.Domain(
    "mug_kitchen",
    scene=build_kitchen_scene,
    task=MugTask,
    tasks={"lift": {}},
    env_id="Mine/MugKitchen-v1",
    episode_steps=280,
)

if __name__ == "__main__":
    suite.register(MUG_KITCHEN)
    environment = suite.load("mug_kitchen", "lift", {"random": 0})
    timestep = environment.reset()
    print("mass [kg]:", environment.physics.named.model.body_mass["mug/"])
    print("position with noise [m]:", timestep.observation["mug_position"])
    env = gymnasium.make("Mine/MugKitchen-v1")
    env.reset(seed=0)
    print("single:", env.step(np.zeros(9))[1])
    envs = gymnasium.make_vec("Mine/MugKitchen-v1", num_envs=4)
    envs.reset(seed=0)
    print("vectorised:", envs.step(np.zeros((4, 9)))[1])
    for physics in ("exact", "fast"):
        environment = MUG_KITCHEN.load(physics=physics, control_mode="ee_pose", time_limit=None)
        environment.reset()
        print(physics, Grasp(environment, "mug").play(environment))
