"""Layouts drawn for a task, without the task's own variations: values of parameters set at each start."""

import importlib

import numpy as np

from kitchen_suite import suite
from kitchen_suite.tasks.layouts.check import LayoutCheck

# Site that the hand must reach for each task of the kitchen: prop and site.
KITCHEN_HANDLES = {
    "bottom burner": ("oven", "knob_2"),
    "top burner": ("oven", "knob_4"),
    "light switch": ("hood", "switch"),
    "slide cabinet": ("slide_cabinet", "handle"),
    "hinge cabinet": ("hinge_cabinet", "right_handle"),
    "microwave": ("microwave", "handle"),
    "kettle": ("kettle", "handle"),
}

KITCHEN_POSES = (
    "franka/base_pose",
    "microwave/pose",
    "slide_cabinet/pose",
    "hinge_cabinet/pose",
    "hood/pose",
    "oven/pose",
)


def table(domain):
    """Returns how the layout of a domain varies."""
    return importlib.import_module(f"kitchen_suite.tasks.{domain}.variations").LAYOUT


def scene_parameters(scene):
    """Returns the parameters of a scene by name."""
    entities = (scene.arena, scene.robot, *scene.props.values())
    return {parameter.name: parameter for entity in entities for parameter in entity.parameters}


def task_handles(task):
    """Returns the sites that the hand must reach."""
    scene = task.scene
    if task.domain_name == "open_cabinet":
        return [scene.cabinet.handle_site(task.drawer)]
    if task.domain_name == "microwave_table":
        return list(scene.props["microwave"].handles)
    names = [KITCHEN_HANDLES[name] for name in task.mdp.goals.tasks]
    return [scene.props[prop].mjcf_model.find("site", site) for prop, site in names]


class LayoutEpisodes:
    """An environment whose episodes start in given values of its layout parameters.

    Attributes:
      values: set at the next starts; the other parameters have their defaults.
    """

    def __init__(self, domain, task_name, **options):
        self.environment = suite.load(domain, task_name, {"visuals": False, "random": 0, **options})
        self.environment.reset()
        self.table, self.values = table(domain), {}
        self.parameters = scene_parameters(self.environment.task.scene)
        self.check = LayoutCheck(self.environment.task.scene, task_handles(self.environment.task))
        self.check.bind(self.physics)
        self._qpos = self.physics.data.qpos.copy()
        self._default = {name: parameter.get(self.physics) for name, parameter in self.parameters.items()}
        task, reset = self.environment.task, self.environment.task._reset_physics

        def reset_physics(physics, random_state):
            reset(physics, random_state)
            self._write(self._filled(self.values))

        task._reset_physics = reset_physics

    @property
    def physics(self):
        return self.environment.physics

    def set(self, values):
        """Sets the default layout with some other values, all objects at their start; returns the physics."""
        self.physics.data.qpos[:] = self._qpos
        self._write(self._filled(values))
        return self.physics

    def draw(self, split, random_state):
        """Returns accepted values, and the number of refused ones before them."""
        for refused in range(20):
            values = {each.name: each.distribution(split)(random_state=random_state) for each in self.table}
            if self.check.accepts(self.set(values)):
                return values, refused
        raise AssertionError("20 layouts in succession were refused")

    def play(self, policy):
        """Plays an episode in the present values; returns its metrics."""
        timestep = self.environment.reset()
        while not timestep.last():
            timestep = self.environment.step(policy(timestep))
        return self.environment.task.episode_metrics

    def _filled(self, values):
        """Returns values of all parameters of the layout."""
        return {varied.name: self._default[varied.name] for varied in self.table} | values

    def _write(self, values):
        for name, value in values.items():
            self.parameters[name].set(self.physics, self.parameters[name].quantity.checked(value, name))


def successes(episodes, policy, split, count, seed):
    """Plays episodes in drawn layouts; returns the number of successes, and of refused layouts."""
    random_state, succeeded, refused = np.random.RandomState(seed), 0, 0
    for _ in range(count):
        episodes.values, before = episodes.draw(split, random_state)
        refused += before
        succeeded += episodes.play(policy)["success"]
    return succeeded, refused
