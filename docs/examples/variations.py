"""Varies start, layout and dynamics, with values for training (seen) and for evaluation (held out).

python variations.py
python variations.py --groups layout --episodes=20
"""

import argparse

import gymnasium
import numpy as np

SHOWN = ("kettle/mass", "kettle/burner", "microwave/friction_scale")

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--groups", nargs="+", default=["start", "layout", "dynamics"], help="groups that vary")
parser.add_argument("--episodes", type=int, default=5, help="episodes of each split (default: %(default)s)")
options = parser.parse_args()


def handles(split: str) -> None:
    """Prints where the kettle's handle is in the episodes of a split, and the values that put it there."""
    env = gymnasium.make(
        "kitchen_suite:KitchenSuite/Kettle-v1",
        variations=options.groups,
        variation_split=split,
        obs_type="environment_state_agent_pos",
        extra_observables=("kettle/handle_positions",),
    )
    print(f"{split}: {len(env.unwrapped.variation_space)} parameters vary")
    positions = []
    for seed in range(options.episodes):
        observation, info = env.reset(seed=seed)
        positions.append(observation["environment_state"][-3:])
        values = {name: info["variation_values"][name] for name in SHOWN if name in info["variation_values"]}
        print(
            f"  seed {seed}: handle at {positions[-1].round(3)} m,", *(f"{name}={values[name]:.3g}" for name in values)
        )
    spread = 100 * np.ptp(positions, axis=0)
    print("  handle's range over the episodes [cm]:", spread.round(1))
    env.close()


for split in ("seen", "held_out"):
    handles(split)
