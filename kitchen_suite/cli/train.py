"""Trains a policy by PPO on many environments at once. Needs no display, but the extra `train`.

  kitchen-train --output=runs/drawer                           opens the top drawer
  kitchen-train --output=runs/drawer --resume                  continues an interrupted run
  kitchen-train --output=runs/hold --task_kwargs='{"gripper": "deterministic"}'
  kitchen-train --output=runs/kettle --domain_name=kitchen --task_name=kettle --demonstrations=kettle
                                                               clones a recording first
  kitchen-train --output=runs/more --initial_policy=runs/drawer/policy.npz
                                                               starts from a trained policy
  kitchen-train --output=runs/small --hyperparameters='{"num_envs": 512, "hidden": [128, 64]}'
  tensorboard --logdir=runs                                    shows the curves, also during training

The folder gets a folder for each seed: curves for TensorBoard, the last checkpoints, and `policy.npz`, the best policy
of all evaluations on held-out seeds; `kitchen-play --policy_file=...` plays it. A seed without progress is given up for
the next one. With --video, an episode of the best policy is filmed at the end. Exit status: 0; 1 if writing or the
physics failed, learning diverged, or no checkpoint can be read; 2 for a bad argument, with one line on stderr; 130 if
interrupted.
"""

import sys

from kitchen_suite.cli.command import Command
from kitchen_suite.training.settings import TrainSettings

COMMAND = Command(
    name="kitchen-train",
    description=__doc__,
    settings=TrainSettings,
    job="kitchen_suite.training.train_job:TrainJob",
    renders=lambda settings: settings.video is not None,
    needs=(("tensorboard", "torch"), "train"),
)
main, console_main = COMMAND.main, COMMAND.console_main

if __name__ == "__main__":
    sys.exit(console_main())
