"""Trains a policy by behaviour cloning of the scripted expert, and evaluates it on other seeds.

Needs pip install '.[experts,train]'. From a shell: kitchen-record, kitchen-train, kitchen-evaluate.

python imitate.py
python imitate.py --task=kettle --episodes=100 --num_steps=3000 --width=384 --output=runs
"""

import argparse
import json
import os
import tempfile

from kitchen_suite.commands.commands import evaluate, record, train

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--task", default="microwave", help="task of the kitchen (default: %(default)s)")
parser.add_argument("--episodes", type=int, default=30, help="demonstrations (default: %(default)s)")
parser.add_argument("--num_steps", type=int, default=600, help="steps of the optimiser (default: %(default)s)")
parser.add_argument("--width", type=int, default=128, help="width of the network (default: %(default)s)")
parser.add_argument("--output", help="folder to write to (default: a temporary one)")
options = parser.parse_args()

with tempfile.TemporaryDirectory() as temporary:
    folder = options.output or temporary
    demonstrations, run, results = (os.path.join(folder, name) for name in ("demonstrations", "run", "results.json"))
    task = [f"--task_name={options.task}"]
    noisy_expert = ["--policy=expert(action_noise=0.1, jitter=0.01)", f"--num_episodes={options.episodes}"]
    assert not record.main([*task, *noisy_expert, f"--output={demonstrations}"])

    settings = {"width": options.width, "batch_size": 128, "averaging": 0.98}
    clone = ["--domain_name=kitchen", "--algorithm=bc", f"--demonstrations={demonstrations}", f"--output={run}"]
    lengths = [f"--num_steps={options.num_steps}", f"--eval_interval={options.num_steps}", "--eval_episodes=5"]
    assert not train.main([*task, *clone, *lengths, f"--hyperparameters={json.dumps(settings)}"])

    # The protocol `default` varies the start, which no demonstration did; null leaves the variation out.
    policy = [f"--policy=trained(file={os.path.join(run, 'policy.npz')!r})", '--task_kwargs={"variations": null}']
    assert not evaluate.main([*task, *policy, "--num_episodes=10", f"--json={results}"])
    with open(results, encoding="utf-8") as file:
        print("success:", json.load(file)["success"])
