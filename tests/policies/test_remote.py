"""Policies on a server: requests, chunks, lost connections, and answers that make no sense."""

import contextlib
import functools
import inspect
import json
import subprocess
import sys
import threading
import time
import types

import dm_env
import msgpack
import numpy as np
import pytest
from dm_env import specs
from docs_scripts import load_script
from helpers.errors import assert_is_short, refused
from helpers.policies_with_memory import EPISODES, LIMIT, SPEC, Chunks, Recurrent, assert_as_alone, chunk
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

import kitchen_suite
from kitchen_suite import checks, policies
from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.installation import EXTRA_PACKAGES
from kitchen_suite.policies import remote

SIZE = 4
SERVER = load_script("examples/policy_server")
OBSERVATION = {"positions": np.linspace(0, 1, 3), "hand": np.full((2, 2, 3), 255, np.uint8), "time": np.float64(0.5)}
START, NEXT = dm_env.restart(OBSERVATION), dm_env.transition(0.0, OBSERVATION)
pack = functools.partial(msgpack.packb, default=SERVER.packed)
unpack = functools.partial(msgpack.unpackb, object_hook=SERVER.unpacked)


def serving(port, answer, **options):
    """Serves at a port; yields the address.

    `answer` makes a message, or a list of messages, of the number of a request and its message.
    """
    return serving_connections(port, lambda: answer, **options)


@contextlib.contextmanager
def serving_connections(port, make_answer, **options):
    """Serves as `serving`, by what `make_answer` makes for each connection."""
    connections = []

    def handle(connection):
        connections.append(connection)
        connection.send(pack({"name": "test"}))
        answer = make_answer()
        with contextlib.suppress(ConnectionClosed):
            for number, message in enumerate(connection):
                answers = answer(number, message)
                for each in answers if isinstance(answers, list) else [answers]:
                    connection.send(each)

    with serve(handle, "localhost", port, **options) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"ws://localhost:{port}"
        finally:
            server.shutdown()
            thread.join()
            for connection in connections:  # Before websockets 17, a shutdown leaves them open.
                connection.close()


def build(name):
    task = types.SimpleNamespace(
        checked_action=lambda action: checks.vector(action, SIZE, "action"), instruction="open the door", hidden_keys=()
    )
    spec = specs.BoundedArray((SIZE,), np.float64, -1, 1)
    environment = types.SimpleNamespace(action_spec=lambda: spec, task=task)
    return policies.find(name)(environment, np.random.default_rng(0))


@pytest.fixture
def pauses(monkeypatch):
    """The pauses between attempts, which pass at once."""
    found = []
    monkeypatch.setattr(remote, "time", types.SimpleNamespace(sleep=found.append))
    return found


def test_a_chunk_is_played_to_its_end_before_the_next_request(port):
    requests = []

    def answer(number, message):
        requests.append(unpack(message))
        return pack({"actions": np.arange(3 * SIZE, dtype=np.float32).reshape(3, SIZE) + 100 * number})

    with serving(port, answer) as address:
        policy = build(address)
        actions = [policy(START), *(policy(NEXT) for _ in range(4)), policy(START)]
    np.testing.assert_array_equal([action[0] for action in actions], [0, 4, 8, 100, 104, 200])
    assert len(requests) == 3
    for request in requests:
        assert request.pop("prompt") == "open the door"
        np.testing.assert_equal(request, OBSERVATION)
        assert {key: value.dtype for key, value in request.items()} == {
            key: value.dtype for key, value in OBSERVATION.items()
        }


def test_a_single_action_and_the_metadata_are_read_and_the_sentence_is_that_of_the_rollout(port):
    with serving(
        port, lambda number, message: pack({"actions": np.full(SIZE, len(unpack(message)["prompt"]))})
    ) as address:
        policy = build(f"remote(address={address!r}, timeout=20)")
        policies.instruct(policy, lambda: "seven w")
        np.testing.assert_array_equal(policy(START), np.full(SIZE, 7.0))
        environment = types.SimpleNamespace(task=None, action_spec=lambda: specs.Array((SIZE,), float))
        assert remote.RemotePolicy(environment, address, 5.0).metadata == {"name": "test"}


def test_a_second_answer_is_not_taken_for_the_next_one(port):
    answer = pack({"actions": np.zeros(SIZE)})
    with serving(port, lambda number, request: [answer, answer]) as address:
        policy = build(address)
        with refused(policies.PolicyError, address, "not asked for"):
            # The second one may arrive after the next request.
            for _ in range(1_000):
                policy(START)


def array(dtype, data=b"", shape=(0,)):
    return pack({"actions": {b"__ndarray__": True, b"data": data, b"dtype": dtype, b"shape": shape}})


BAD_ANSWERS = {
    "an error of the server": ("Traceback:\n  KeyError: 'observation/state'\n" * 50, "KeyError"),
    "no msgpack": (b"\xc1 hello", "cannot be read"),
    "cut short": (pack({"actions": np.zeros(SIZE)})[:-3], "cannot be read"),
    "nested": (b"\x91" * 5_000, "cannot be read"),
    "pickled objects": (array("|O", b"x" * 64, (8,)), "'|O'"),
    "no type": (array("a,,(2", b"x" * 64, (8,)), "'a,,(2'"),
    "another shape than its data": (array("<f8", b"x" * 64, (2**40, 9)), "cannot be read"),
    "no map": (pack([1.0] * SIZE), "map"),
    "no actions": (pack({"action": np.zeros(SIZE)}), "'action'"),
    "a list": (pack({"actions": [0.0] * SIZE}), "array"),
    "text": (pack({"actions": "forward"}), "'forward'"),
    "bool": (pack({"actions": np.ones(SIZE, bool)}), "array"),
    "a number": (pack({"actions": np.array(1.0)}), "shape"),
    "too many": (pack({"actions": np.zeros((3, SIZE + 1))}), "(3, 5)"),
    "a batch": (pack({"actions": np.zeros((1, 2, SIZE))}), "(1, 2, 4)"),
    "an empty chunk": (pack({"actions": np.zeros((0, SIZE))}), "(0, 4)"),
    "NaN at the end of a chunk": (pack({"actions": np.array([[0.0] * SIZE, [0, 0, 0, np.nan]])}), "finite"),
    "infinity": (pack({"actions": np.full(SIZE, np.inf)}), "finite"),
}


@pytest.mark.parametrize(("message", "shown"), BAD_ANSWERS.values(), ids=BAD_ANSWERS)
def test_an_answer_that_makes_no_sense_is_a_policy_error(message, shown, port, pauses):
    with serving(port, lambda number, request: message) as address:
        policy = build(address)
        with refused(policies.PolicyError, address, shown) as raised:
            policy(START)
    assert_is_short(str(raised.value))
    assert pauses == []


def test_messages_that_are_too_large_for_either_side_are_not_sent_again(port, pauses, monkeypatch):
    for options in ({"max_size": 100}, {}):
        with serving(port, lambda number, request: bytes(2_000), **options) as address:
            policy = build(address)
            with refused(policies.PolicyError, "too large"):
                policy(START)
        monkeypatch.setattr(remote, "MAX_BYTES", 1_000)
    assert pauses == []


def test_without_a_server_a_few_attempts_end_in_one_line(port, pauses):
    with refused(policies.PolicyError, f"localhost:{port}", "the server is not there") as raised:
        build(f"ws://localhost:{port}")
    assert_is_short(str(raised.value))
    assert len(pauses) == 5
    assert pauses == sorted(pauses)


def test_a_request_is_sent_again_to_a_server_that_is_restarted_in_an_episode(port, monkeypatch):
    def answer(number, message):
        return pack({"actions": unpack(message)["positions"][-1] * np.full(SIZE, 0.5)})

    with contextlib.ExitStack() as stack, contextlib.ExitStack() as first:
        policy = build(first.enter_context(serving(port, answer)))
        policy(START)
        first.close()
        restart = types.SimpleNamespace(sleep=lambda pause: stack.enter_context(serving(port, answer)))
        monkeypatch.setattr(remote, "time", restart)
        np.testing.assert_array_equal(policy(NEXT), np.full(SIZE, 0.5))


def test_a_server_that_dies_and_one_that_is_none_are_policy_errors(port, pauses):
    with serving(port, lambda number, message: pack({"actions": np.zeros(SIZE)})) as address:
        policy = build(address)
        policy(START)
    with refused(policies.PolicyError, address, "the server is not there"):
        policy(NEXT)
    assert len(pauses) == 5
    with serve(None, "localhost", port, process_request=lambda connection, request: connection.respond(404, "")) as web:
        threading.Thread(target=web.serve_forever).start()
        with refused(policies.PolicyError, address, "404"):
            build(address)
        web.shutdown()


def test_a_server_that_does_not_answer_is_given_up(port):
    resume = threading.Event()
    with serving(port, lambda number, message: pack({"late": resume.wait(20)})) as address:
        policy = build(f"remote(address={address!r}, timeout=0.2)")
        with refused(policies.PolicyError, "within 0.2 s"):
            policy(START)
        resume.set()


def test_a_connection_is_closed_with_its_policy(port):
    with serving(port, lambda number, message: pack({"actions": np.zeros(SIZE)})) as address:
        before = set(threading.enumerate())
        kept = [build(address) for _ in range(3)]
        opened = set(threading.enumerate()) - before
        assert opened
        del kept
        deadline = time.monotonic() + 20
        while any(thread.is_alive() for thread in opened) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not [thread for thread in opened if thread.is_alive()]


@pytest.mark.parametrize(
    "name",
    ["remote", "remote(address='http://localhost')", "remote(address=3)", "ws://local host", "ws://", "ws://h:port"]
    + [f"remote(address='ws://localhost:1', {option})" for option in ("timeout=0", "timeout='1'", "retries=3")],
)
def test_malformed_addresses_and_options_are_refused(name, pauses):
    with refused(ValueError) as raised:
        build(name)
    assert_is_short(str(raised.value))


@pytest.mark.full
def test_without_the_extra_the_error_names_it_and_nothing_is_imported(monkeypatch):
    monkeypatch.setitem(EXTRA_PACKAGES, "remote", ("msgpack", "websockets_that_are_not_there"))
    with refused(ImportError, "ws://localhost:1", "websockets_that_are_not_there", "kitchen-suite[remote]"):
        policies.find("ws://localhost:1")
    code = "import sys, kitchen_suite.policies; assert not {'msgpack', 'websockets'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.full
def test_commands_play_by_a_server_and_send_the_sentence_of_each_environment(port, folder, run, refusal, pauses):
    prompts = []

    def answer(number, message):
        prompts.append(unpack(message)["prompt"])
        return pack({"actions": np.full((5, 9), 0.1 * len(prompts[-1]) % 1)})

    options = (f"--policy=ws://localhost:{port}", "--max_episode_steps=8", "--num_episodes=3")
    with serving(port, answer):
        arguments = ("--output=runs", "--num_envs=2", "--num_threads=1", "--task_name=random_2", *options)
        assert run(record, *arguments)[0] == 0
        assert json.loads((folder / "runs" / "recording.json").read_text())["policy"] == f"ws://localhost:{port}"
        # Two requests for each episode, of an own pair of tasks.
        recorded, prompts[:] = [*prompts], []
        assert len(recorded) == 6
        assert len(set(recorded)) > 1
        # One after the other, each episode is the same.
        assert run(record, "--output=alone", "--num_envs=1", *arguments[2:])[0] == 0
        assert sorted(prompts) == sorted(recorded)
        prompts.clear()
        assert run(rollout, "--task_name=random_2", *options)[0] == 0
        assert len(set(prompts)) > 1
        assert run(evaluate, "--json=scores.json", "--num_envs=2", options[0], "--num_episodes=2", options[1])[0] == 0
        assert json.loads((folder / "scores.json").read_text())["policy"] == f"ws://localhost:{port}"
    for command in (rollout, record, evaluate):
        output = () if command is not record else ("--output=other",)
        assert "the server is not there" in refusal(command, options[0], *output)


@pytest.fixture
def example(port):
    """The address of docs/examples/policy_server.py, in a process of its own."""
    server = subprocess.Popen([sys.executable, SERVER.__file__, str(port)])
    try:
        yield f"ws://localhost:{port}"
    finally:
        server.terminate()
        server.wait()


@pytest.mark.full
def test_the_example_is_short_and_brakes_the_arm(example, run):
    status, output, _ = run(rollout, f"--policy={example}", "--num_episodes=1", "--max_episode_steps=12")
    assert (status, f"policy {example}" in output) == (0, True)
    assert len(inspect.getsource(SERVER).splitlines()) <= 50


@pytest.mark.clients
def test_openpis_own_client_reads_the_examples_server(example):
    from openpi_client.websocket_client_policy import WebsocketClientPolicy

    build(example)  # Waits for the server.
    client = WebsocketClientPolicy(example)
    assert client.get_server_metadata() == {"policy": "brake"}
    answer = client.infer({"franka/joint_velocities": np.linspace(-1, 1, 9), "prompt": "open the door"})
    np.testing.assert_array_equal(answer["actions"], np.tile(-np.sign(np.linspace(-1, 1, 9)), (5, 1)))


@pytest.mark.clients
def test_a_server_with_openpis_own_encoding_is_understood(port):
    from openpi_client import msgpack_numpy

    def answer(number, message):
        request = msgpack_numpy.unpackb(message)
        assert request["hand"].dtype == np.uint8
        actions = np.full((2, SIZE), request["positions"][-1], np.float32)
        return msgpack_numpy.packb({"actions": actions, "server_timing": {"infer_ms": np.float64(1.5)}})

    with serving(port, answer) as address:
        np.testing.assert_array_equal(build(address)(START), np.ones(SIZE))


def answer_of_chunks():
    return lambda number, message: pack({"actions": np.array(chunk(joints_of(message)))})


def answer_of_recurrent():
    """Answers by a hidden state of the connection, which is that of an episode."""
    policy = Recurrent()
    return lambda number, message: pack({"actions": policy(joints_of(message))})


def joints_of(message):
    return unpack(message)["joint_positions"].astype(np.float64)


@pytest.mark.full
@pytest.mark.parametrize(
    ("make_answer", "policy"),
    [(answer_of_chunks, Chunks), (answer_of_recurrent, Recurrent)],
    ids=["chunks", "recurrent"],
)
def test_episodes_of_a_server_are_the_same_in_1_4_and_16_environments(make_answer, policy, port, folder, run):
    options = ["--domain_name=open_cabinet", f"--num_episodes={EPISODES}", f"--max_episode_steps={LIMIT}"]
    with serving_connections(port, make_answer) as address:
        for count in (1, 4, 16):
            assert_as_alone(kitchen_suite.play(SPEC, address, range(EPISODES), num_envs=count), policy)
            arguments = [*options, f"--policy={address}", f"--num_envs={count}"]
            assert run(evaluate, *arguments, f"--json={count}.json", f"--receipt={count}.npz")[0] == 0
    for count in (4, 16):
        assert (folder / f"{count}.json").read_bytes() == (folder / "1.json").read_bytes()
        assert (folder / f"{count}.npz").read_bytes() == (folder / "1.npz").read_bytes()
