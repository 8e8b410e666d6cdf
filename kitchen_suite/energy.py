"""A bound on the energy that random actions put into a scene: what exceeds it is thrown, not moved."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import mujoco
import numpy as np
from dm_control.rl import control
from dm_env import specs
from numpy.typing import NDArray

from kitchen_suite.environment import Environment
from kitchen_suite.types import Array

STEPS = 10
"""Control steps of random actions that are bounded."""

# Greatest speed to which the energy of a body corresponds [m/s]. The hand moves it at 1 to 2 m/s; random actions in the
# suite's own scenes leave all bodies below 0.2 m/s.
MAX_SPEED = 5.0

# Depth from which on a body counts as inside another one [m]: contacts at rest are a tenth of it.
_DEPTH = 1e-3


def check_energy(environment: Environment) -> None:
    """Plays some control steps of random actions; raises a ValueError if a body gains more energy than by a hand.

    The robot's own bodies are left out. The message says what to change.
    """
    environment.reset()
    bodies = _bodies(environment)
    inside = _deepest_contacts(environment)
    start = _energy(environment, bodies)
    generator = np.random.default_rng(0)
    for step in range(1, STEPS + 1):
        try:
            environment.step(_random_action(environment.action_spec(), generator))
        except control.PhysicsError as error:
            raise ValueError(
                f"the physics diverges at control step {step} of random actions: {'; '.join(inside.values()) or error}"
            ) from error
        gain = _energy(environment, bodies) - start
        if bodies.size and not gain.max() <= MAX_SPEED**2 / 2:
            body = int(bodies[np.argmax(np.where(np.isnan(gain), np.inf, gain))])
            raise ValueError(_message(environment, body, float(np.max(gain)), step, inside.get(body, "")))


def _bodies(environment: Environment) -> NDArray[np.int64]:
    """Returns the indices of bodies that move and are not of the robot."""
    physics = environment.physics
    model = physics.model
    robot = physics.bind(environment.task.robot.mjcf_model.find_all("body")).element_id
    moves = (model.body_weldid != 0) & (model.body_mass > 0.0)
    moves[robot] = False
    return np.flatnonzero(moves)


def _energy(environment: Environment, bodies: NDArray[np.int64]) -> Array:
    """Returns kinetic and potential energy of bodies, divided by their masses [J/kg]."""
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    velocity = np.empty(6)
    energies = np.empty(bodies.size)
    for place, body in enumerate(bodies):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 1)
        angular, linear = velocity[:3], velocity[3:]
        turning = (model.body_inertia[body] * angular**2).sum() / model.body_mass[body]
        energies[place] = (linear @ linear + turning) / 2 - model.opt.gravity @ data.xipos[body]
    return energies


def _deepest_contacts(environment: Environment) -> dict[int, str]:
    """Returns the deepest contact of each body that is inside another one, in words."""
    model, found = environment.physics.model, {}
    contacts = sorted(environment.physics.data.ptr.contact, key=lambda contact: -contact.dist)
    for contact in contacts:
        if contact.dist < -_DEPTH:
            names = [model.id2name(geom, "geom") or f"geom {geom}" for geom in contact.geom]
            for body, other in zip(model.geom_bodyid[contact.geom], reversed(names), strict=True):
                found[int(body)] = f"it starts {-1000 * contact.dist:.1f} mm inside {other!r}: start it free of that"
    return found


def _random_action(spec: specs.Array, generator: np.random.Generator) -> Array:
    action = generator.normal(size=spec.shape)
    return action.clip(spec.minimum, spec.maximum) if isinstance(spec, specs.BoundedArray) else action


def _message(environment: Environment, body: int, gain: float, step: int, inside: str) -> str:
    scene = environment.task.scene
    name = environment.physics.model.id2name(body, "body") or f"body {body}"
    remedy = inside or (
        "make it heavier or its contacts softer (solref with a time constant of at least two physics steps of "
        f"{scene.physics_timestep:g} s), or make the physics steps shorter"
    )
    return (
        f"after {step} control steps of random actions in {scene.physics} physics, {name!r} has gained {gain:.3g} "
        f"J/kg, as if thrown at {np.sqrt(2 * gain):.2g} m/s, while a hand moves things at 1 to 2 m/s: {remedy}; "
        "see docs/guide/your_task.md"
    )
