"""TorchRL's MinariExperienceReplay has the recordings of kitchen-record, number for number."""

import numpy as np
import pytest

import kitchen_suite.environment  # noqa: F401  chooses a GL library, which a command without pictures does not
from kitchen_suite.commands import convert, record

pytestmark = pytest.mark.clients

PICTURES = '{"obs_type": "pixels_agent_pos", "cameras": ["workspace", "franka/hand"], "image_size": [24, 32]}'
DEPTH = '{"obs_type": "pixels", "image_size": [16, 16], "depth": true, "segmentation": true}'
RECORDINGS = {
    "goals by task": (),
    "flat goals": ('--task_kwargs={"goal_format": "flat"}',),
    "requested tasks": ("--task_name=random_2", "--variations=start,layout"),
    "reward terms": ("--task_name=microwave", '--task_kwargs={"reward": "dense_gain", "obs_type": "state"}'),
    "drawer": ("--domain_name=open_cabinet", "--seed=3"),
    "control mode": ("--domain_name=microwave_table", "--control_mode=ee_delta_pose"),
    "pictures": (f"--task_kwargs={PICTURES}",),
    "depth": ("--domain_name=open_cabinet", f"--task_kwargs={DEPTH}"),
}
RENDERED = ("pictures", "depth")
# Nested goals, masks of tasks, further terms in infos, and images: the others have the same kinds of arrays.
IN_EVERY_RUN = ("goals by task", "requested tasks", "reward terms", "depth")
EPISODES = 12
ID = "kitchen/recorded-v0"


@pytest.fixture(
    params=[
        pytest.param(
            arguments,
            id=name,
            marks=[
                *([pytest.mark.rendering] if name in RENDERED else []),
                *([] if name in IN_EVERY_RUN else [pytest.mark.nightly]),
            ],
        )
        for name, arguments in RECORDINGS.items()
    ]
)
def dataset(request, tmp_path, monkeypatch):
    import minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    length = ("--max_episode_steps=4", f"--num_episodes={EPISODES}")
    assert record.main([f"--output={tmp_path / 'runs'}", *length, *request.param]) == 0
    assert convert.main([str(tmp_path / "runs"), f"--dataset={ID}"]) == 0
    return minari.load_dataset(ID)


def replay_buffer(tmp_path, **options):
    from kitchen_suite.adapters.torchrl import load_recording

    return load_recording(ID, root=tmp_path / "torchrl", **options)


def leaves(values, prefix=()):
    """Yields the arrays of nested dicts with their keys; slashes in names of Minari's infos are groups of HDF5."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from leaves(value, (*prefix, *key.split("/")))
    else:
        yield prefix, values


def test_every_number_is_the_recordings(dataset, tmp_path):
    buffer = replay_buffer(tmp_path, batch_size=8)
    assert len(buffer) == dataset.total_steps
    steps, start = buffer[:], 0
    for episode in dataset:
        part, start = steps[start : start + len(episode)], start + len(episode)
        assert (part["episode"] == episode.id).all()
        recorded = [*leaves({"observation": episode.observations, "info": episode.infos})]
        found = {key if isinstance(key, tuple) else (key,) for key in part.keys(True, True)}
        assert {key for key, _ in recorded} == {key for key in found if key[0] in ("observation", "info")}
        for key, values in recorded:
            np.testing.assert_array_equal(part[key].numpy(), values[:-1], strict=True)
            np.testing.assert_array_equal(part["next", *key].numpy(), values[1:], strict=True)
        np.testing.assert_array_equal(part["action"].numpy(), episode.actions, strict=True)
        np.testing.assert_array_equal(part["next", "reward"].numpy()[:, 0], episode.rewards, strict=True)
        ends = {"terminated": episode.terminations, "truncated": episode.truncations}
        for name, values in (ends | {"done": episode.terminations | episode.truncations}).items():
            np.testing.assert_array_equal(part["next", name].numpy()[:, 0], values, strict=True)
    assert start == len(buffer)
    assert buffer.sample().batch_size == (8,)


@pytest.mark.parametrize("dataset", [()], indirect=True)
def test_pieces_of_episodes_can_be_drawn(dataset, tmp_path):
    from torchrl.data.replay_buffers import SliceSampler

    buffer = replay_buffer(tmp_path, batch_size=20, sampler=SliceSampler(slice_len=2, traj_key="episode"))
    pieces = buffer.sample().reshape(10, 2)
    assert (pieces["episode"][:, 0] == pieces["episode"][:, 1]).all()
    assert (pieces["info", "episode_step"].diff(dim=1) == 1).all()
    buffer = replay_buffer(tmp_path / "split", batch_size=3, split_trajs=True)
    assert buffer[:]["action"].shape == (EPISODES, 4, 9)
    assert buffer[:]["mask"].all()
