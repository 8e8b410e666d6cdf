"""Trains a policy by behaviour cloning of the scripted expert, and evaluates it on other seeds.

Needs pip install '.[experts,train]'. From a shell: kitchen-record, kitchen-train, kitchen-evaluate.

python imitate.py
python imitate.py --task=kettle --episodes=100 --num_steps=3000 --width=384 --output=runs
"""

import argparse
import json
import os
import tempfile

import kitchen_suite
from kitchen_suite import EnvironmentSpec
from kitchen_suite.commands import train

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--task", default="microwave", help="task of the kitchen (default: %(default)s)")
parser.add_argument("--episodes", type=int, default=30, help="demonstrations (default: %(default)s)")
parser.add_argument("--num_steps", type=int, default=600, help="steps of the optimiser (default: %(default)s)")
parser.add_argument("--width", type=int, default=128, help="width of the network (default: %(default)s)")
parser.add_argument("--output", help="folder to write to (default: a temporary one)")
options = parser.parse_args()

with tempfile.TemporaryDirectory() as temporary:
    folder = options.output or temporary
    demonstrations = os.path.join(folder, "demonstrations")
    run = os.path.join(folder, "run")
    spec = EnvironmentSpec.make("kitchen", options.task, {})
    kitchen_suite.record(demonstrations, spec, "expert(action_noise=0.1, jitter=0.01)", num_episodes=options.episodes)

    settings = {"width": options.width, "batch_size": 128, "averaging": 0.98}
    task = ["--domain_name=kitchen", f"--task_name={options.task}"]
    clone = ["--algorithm=bc", f"--demonstrations={demonstrations}", f"--output={run}"]
    lengths = [f"--num_steps={options.num_steps}", f"--eval_interval={options.num_steps}", "--eval_episodes=5"]
    assert not train.main([*task, *clone, *lengths, f"--hyperparameters={json.dumps(settings)}"])

    # The protocol `default` varies the start, which no demonstration did; None leaves the variation out.
    evaluation = kitchen_suite.evaluate(
        os.path.join(run, "policy.npz"), task_name=options.task, task_kwargs={"variations": None}, num_episodes=10
    )
    print("success:", evaluation.scores["success"])
