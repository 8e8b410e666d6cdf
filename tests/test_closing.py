"""A constructor that fails closes what it has opened."""

import contextlib
import dataclasses
import functools
import threading

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused
from websockets.sync.server import serve

from kitchen_suite import EnvironmentSpec, agreement, suite
from kitchen_suite.closing import closed_on_error
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.replay import Replay
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.policies import remote
from kitchen_suite.rendering import contexts
from kitchen_suite.vector_env import base


class Opened:
    """Something that is open until it is closed."""

    def __init__(self, error=None):
        self.is_open = True
        self._error = error

    def close(self):
        self.is_open = False
        if self._error:
            raise self._error


@pytest.mark.parametrize("error", [ValueError("bad"), KeyboardInterrupt()])
def test_an_error_or_interrupt_closes_everything(error):
    first, late = Opened(), Opened()
    opened = [first]

    def fail():
        with closed_on_error(opened):
            opened.append(late)
            raise error

    with pytest.raises(type(error)) as raised:
        fail()
    assert raised.value is error
    assert not any(each.is_open for each in opened)


def test_an_error_of_closing_leaves_nothing_else_open():
    opened = [Opened(), Opened(OSError("gone")), Opened()]
    with pytest.raises(OSError, match="gone"), closed_on_error(opened):
        raise ValueError
    assert not any(each.is_open for each in opened)


def test_without_an_error_all_stays_open():
    opened = Opened()
    with closed_on_error([opened]):
        pass
    assert opened.is_open


@pytest.fixture
def open_environments(monkeypatch):
    """The single environments of Gymnasium that are open, those that start the episodes of vectors included."""
    found = []
    build, close = SuiteEnv.__init__, SuiteEnv.close

    # With the signature of the class, which is inspected once, and would be this function's in later tests.
    @functools.wraps(build)
    def built(self, *arguments, **options):
        build(self, *arguments, **options)
        found.append(self)

    def closed(self):
        close(self)
        found[:] = [each for each in found if each is not self]

    monkeypatch.setattr(SuiteEnv, "__init__", built)
    monkeypatch.setattr(SuiteEnv, "close", closed)
    return found


def failing(*arguments, **options):
    raise ValueError("it fails")


@pytest.mark.full
def test_a_vector_that_cannot_be_built_closes_its_templates(open_environments, monkeypatch):
    monkeypatch.setattr(base, "BatchEpisodes", failing)
    with refused(ValueError, "it fails"):
        gymnasium.make_vec("KitchenSuite/FrankaMicrowaveTable-v1", 2, vectorization_mode="vector_entry_point")
    assert open_environments == []


@pytest.mark.full
@pytest.mark.rendering
def test_a_vector_of_pictures_that_cannot_be_built_frees_its_contexts(monkeypatch):
    made, freed = [], []
    build, free = contexts.Context.__init__, contexts.Context.free
    monkeypatch.setattr(contexts.Context, "__init__", lambda self, *size: made.append(self) or build(self, *size))
    monkeypatch.setattr(contexts.Context, "free", lambda self: freed.append(self) or free(self))
    monkeypatch.setattr(base, "BatchEpisodes", failing)
    with refused(ValueError, "it fails") as raised:
        gymnasium.make_vec(
            "KitchenSuite/FrankaMicrowaveTable-v1", 2, vectorization_mode="vector_entry_point", obs_type="pixels"
        )
    assert raised
    assert len(made) == 1
    assert {*map(id, made)} <= {*map(id, freed)}


@pytest.mark.full
def test_kitchens_of_a_vector_are_closed_where_the_next_cannot_be_built(open_environments):
    with refused(ValueError, "design[1]"):
        gymnasium.make_vec("KitchenSuite/Kitchens-v1", 2, vectorization_mode="vector_entry_point", design=[0, -3])
    assert open_environments == []


@pytest.mark.full
def test_a_domain_that_is_refused_leaves_no_environment_open(open_environments, monkeypatch):
    closed = []
    close = Environment.close
    monkeypatch.setattr(Environment, "close", lambda self: closed.append(self) or close(self))
    monkeypatch.setattr(agreement, "_check_episodes", failing)
    domain = dataclasses.replace(suite.DOMAINS["microwave_table"], name="again", env_id="Again/Table-v1")
    with refused(ValueError, "it fails"):
        suite.register(domain)
    assert open_environments == []
    assert len(closed) == 1


@pytest.mark.full
def test_a_recording_that_cannot_be_replayed_leaves_no_environment_open(open_environments, tmp_path, monkeypatch):
    import kitchen_suite

    spec = EnvironmentSpec.make("microwave_table", "open", {}, 3)
    kitchen_suite.record(tmp_path / "run", spec, "random", num_episodes=1)
    assert open_environments == []
    recording = kitchen_suite.episodes.recording.Recording.open(tmp_path / "run")

    def without_gl(self, *, seed=None, options=None):
        raise RuntimeError("no GL library")

    monkeypatch.setattr(SuiteEnv, "reset", without_gl)
    with refused(OSError, "the recording holds images: no GL library"):
        Replay(recording, None, 1)
    assert open_environments == []


@pytest.mark.clients
def test_a_training_whose_demonstrations_cannot_be_read_closes_its_environments(open_environments, tmp_path):
    from kitchen_suite.training import ppo, recipes

    spec = EnvironmentSpec.make("microwave_table", "open", {})
    schedule = recipes.find_schedule("microwave_table", "ppo")
    changes = {"hyperparameters": {"num_envs": 2}, "demonstrations": [tmp_path], "num_threads": 1}
    with pytest.raises(OSError, match="no recording"):
        ppo.train(tmp_path / "run", spec, schedule, **changes)
    assert open_environments == []


@pytest.mark.clients
def test_a_training_whose_evaluations_cannot_be_built_closes_its_environments(open_environments, tmp_path, monkeypatch):
    from kitchen_suite.training import recipes
    from kitchen_suite.training.ppo import train

    build = EnvironmentSpec.make_vector_env
    built = []

    def make(self, num_envs, *arguments, **options):
        built.append(num_envs)
        return failing() if len(built) == 2 else build(self, num_envs, *arguments, **options)

    monkeypatch.setattr(EnvironmentSpec, "make_vector_env", make)
    spec = EnvironmentSpec.make("microwave_table", "open", {})
    schedule = recipes.find_schedule("microwave_table", "ppo")
    with refused(ValueError, "it fails"):
        train(tmp_path / "run", spec, schedule, hyperparameters={"num_envs": 2}, num_threads=1)
    assert built == [2, 20]
    assert open_environments == []


@pytest.mark.clients
def test_environments_that_stable_baselines3_refuses_are_closed(open_environments):
    from kitchen_suite.adapters.stable_baselines3 import make_vec_env

    with refused(ValueError, "nested observations"):
        make_vec_env("KitchenSuite/FrankaKitchen-v1", 2)
    assert open_environments == []


@pytest.mark.web
def test_an_episode_that_cannot_be_started_in_the_viewer_leaves_no_environment_open(open_environments, monkeypatch):
    from kitchen_suite.viewer import live_episode

    monkeypatch.setattr(live_episode.LiveEpisode, "start", failing)
    choice = live_episode.Choice(domain_name="microwave_table", task_name="open")
    with refused(ValueError, "it fails"):
        live_episode.started_episode(choice, 0, render_quality="fast")
    assert open_environments == []


@pytest.mark.web
def test_a_wrapper_that_cannot_be_built_frees_its_port(port, monkeypatch):
    from kitchen_suite.viewer import intervention
    from kitchen_suite.viewer.servers import local_server

    monkeypatch.setattr(intervention, "HandPanel", failing)
    with refused(ValueError, "it fails"):
        intervention.InterventionWrapper(gymnasium.make("KitchenSuite/Kettle-v1"), port)
    with local_server(port):
        pass


def test_a_policy_whose_server_refuses_it_closes_its_connection(port):
    ended = threading.Event()

    def handle(connection):
        connection.send("no policy here")
        with contextlib.suppress(Exception):
            connection.recv()
        ended.set()

    class Spec:
        shape = (4,)

    class Simulated:
        task = None

        def action_spec(self):
            return Spec

    with serve(handle, "localhost", port) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            # The error keeps the policy: its connection must not wait for the collector.
            with refused(ConnectionError, "no policy here") as raised:
                remote.RemotePolicy(Simulated(), f"ws://localhost:{port}", 5.0)
            assert ended.wait(5.0)
            assert raised.value is not None
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.full
def test_environments_that_are_built_stay_open(open_environments):
    env = gymnasium.make("KitchenSuite/FrankaMicrowaveTable-v1")
    assert len(open_environments) == 1
    env.reset(seed=0)
    assert np.isfinite(env.step(np.zeros(8))[1])
    env.close()
    assert open_environments == []
