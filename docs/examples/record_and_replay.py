"""Records demonstrations of the scripted expert as a dataset, reads it with Minari, and replays it.

Needs pip install '.[experts,record]'. From a shell: kitchen-record, kitchen-convert, kitchen-replay.

python record_and_replay.py
python record_and_replay.py --task=complete --episodes=20 --control_mode=ee_delta_pose --output=demonstrations
"""

import argparse
import os
import tempfile

import minari

import kitchen_suite
from kitchen_suite import EnvironmentSpec

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--task", default="kettle", help="task of the kitchen (default: %(default)s)")
parser.add_argument("--episodes", type=int, default=2, help="number of episodes (default: %(default)s)")
parser.add_argument("--control_mode", default="joint_velocity", help="meaning of the actions (default: %(default)s)")
parser.add_argument("--output", help="folder to write to (default: a temporary one)")
options = parser.parse_args()

with tempfile.TemporaryDirectory() as temporary:
    folder = os.path.join(options.output or temporary, "episodes")
    datasets = os.path.join(options.output or temporary, "datasets")
    spec = EnvironmentSpec.make("kitchen", options.task, {"control_mode": options.control_mode})
    kitchen_suite.record(folder, spec, "expert(action_noise=0.05, jitter=0.01)", num_episodes=options.episodes)
    kitchen_suite.convert(folder, "minari", "me/demonstrations-v0", datasets)

    os.environ["MINARI_DATASETS_PATH"] = datasets  # where Minari looks for data sets
    for episode in minari.load_dataset("me/demonstrations-v0"):
        print(f"episode {episode.id}: {len(episode)} steps, return {episode.rewards.sum():g}")

    # The recorded actions again, from the recorded seeds: every observation must be equal to the bit.
    print("replay:", kitchen_suite.replay(folder).verdict)
