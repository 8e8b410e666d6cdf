"""A policy server, with openpi's protocol: it brakes the arm, by five actions at a time.

python docs/examples/policy_server.py 8000 &
kitchen-rollout --policy=ws://localhost:8000

Its environment needs `pip install msgpack numpy websockets`, and nothing of the suite.
"""

import sys

import msgpack
import numpy as np
from websockets.sync.server import serve


def packed(array):
    """Returns an array as a message holds it."""
    return {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": array.dtype.str, b"shape": array.shape}


def unpacked(content):
    """Returns the array that a map in a message stands for, or another map as it is."""
    if b"__ndarray__" not in content:
        return content
    return np.frombuffer(content[b"data"], content[b"dtype"]).reshape(content[b"shape"])


def act(observation):
    """Returns actions `(5, 9)` against the joint velocities; `observation["prompt"]` is the task's sentence."""
    return np.tile(-np.sign(observation["franka/joint_velocities"]), (5, 1))


def answer(connection):
    """Sends the server's metadata, then an answer to each message of a connection."""
    connection.send(msgpack.packb({"policy": "brake"}))
    for message in connection:
        actions = act(msgpack.unpackb(message, object_hook=unpacked))
        connection.send(msgpack.packb({"actions": actions}, default=packed))


if __name__ == "__main__":
    with serve(answer, "localhost", int(sys.argv[1]), max_size=2**24) as server:
        server.serve_forever()
