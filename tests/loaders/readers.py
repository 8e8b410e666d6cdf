"""Reads a dataset with the loader of the program that it is for: `python readers.py PROGRAM DATASET RESULT.npz`.

The result has what the loader returned, by name. It runs in an environment where the program is installed, and knows
nothing of the suite.
"""

import json
import sys

import numpy as np


def read_robomimic(path):
    """Every item of `SequenceDataset`, one step each, and the loss of an epoch of behavioural cloning."""
    import h5py
    import robomimic.utils.file_utils as file_utils
    import robomimic.utils.obs_utils as obs_utils
    import robomimic.utils.train_utils as train_utils
    import torch
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils.dataset import SequenceDataset

    with h5py.File(path) as file:
        shapes = {key: rows.shape[1:] for key, rows in file["data/demo_0/obs"].items()}
    config = config_factory("bc")
    with config.unlocked():
        config.observation.modalities.obs.low_dim = [key for key, shape in shapes.items() if len(shape) == 1]
        config.observation.modalities.obs.rgb = [key for key, shape in shapes.items() if len(shape) == 3]
    obs_utils.initialize_obs_utils_with_config(config)
    keys = [*shapes]
    shape_meta = file_utils.get_shape_metadata_from_dataset(path, all_obs_keys=keys)
    env_meta = file_utils.get_env_metadata_from_dataset(path)
    sets = {
        part: SequenceDataset(
            path,
            obs_keys=keys,
            dataset_keys=["actions", "rewards", "dones"],
            hdf5_cache_mode="all",
            filter_by_attribute=part,
        )
        for part in ("train", "valid")
    }
    torch.manual_seed(0)
    model = algo_factory(
        "bc", config, obs_key_shapes=shape_meta["all_shapes"], ac_dim=shape_meta["ac_dim"], device=torch.device("cpu")
    )
    model.set_train()
    batches = torch.utils.data.DataLoader(sets["train"], batch_size=32, shuffle=True)
    loss = train_utils.run_epoch(model=model, data_loader=batches, epoch=1)["Loss"]
    result = {"loss": np.array(loss), "env_meta": np.array(json.dumps(env_meta))}
    for part, items in sets.items():
        rows = [items[number] for number in range(len(items))]
        for name in ("actions", "rewards", "dones"):
            result[f"{part}/{name}"] = np.concatenate([row[name] for row in rows])
        for kind in ("obs", "next_obs"):
            for key in keys:
                result[f"{part}/{kind}/{key}"] = np.concatenate([row[kind][key] for row in rows])
    return result


def read_d3rlpy(path):
    """Episodes of an `MDPDataset`, and the losses of some steps of TD3+BC."""
    import d3rlpy
    import h5py

    names = ("observations", "actions", "rewards", "terminals", "timeouts")
    with h5py.File(path) as file:
        dataset = d3rlpy.dataset.MDPDataset(**{name: file[name][:] for name in names})
    d3rlpy.seed(0)
    algorithm = d3rlpy.algos.TD3PlusBCConfig(batch_size=32).create(device="cpu:0")
    silent = d3rlpy.logging.NoopAdapterFactory()
    # A row an epoch: its number and the averages of its losses.
    epochs = algorithm.fit(dataset, 20, n_steps_per_epoch=10, show_progress=False, logger_adapter=silent)
    losses = [[metrics["critic_loss"], metrics["actor_loss"]] for _, metrics in epochs]
    episodes = dataset.episodes
    return {
        "losses": np.array(losses),
        "lengths": np.array([len(each.rewards) for each in episodes]),
        "terminated": np.array([each.terminated for each in episodes]),
        **{name: np.concatenate([getattr(each, name) for each in episodes]) for name in names[:3]},
    }


READERS = {
    "robomimic": read_robomimic,
    "d3rlpy": read_d3rlpy,
}

if __name__ == "__main__":
    program, dataset, target = sys.argv[1:]
    np.savez(target, **READERS[program](dataset))
