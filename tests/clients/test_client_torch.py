"""PyTorch and images in one process, in any order: PyTorch's triton and Mesa's driver each bring an LLVM.

`bash .ci/stage torch` runs these tests beside PyTorch as PyPI serves it, which brings triton, and the stage `clients`
beside its build for the CPU, which has none.
"""

import itertools

import pytest
from helpers.headless import run

pytestmark = [pytest.mark.torch, pytest.mark.rendering]

STEPS = {
    "make": (
        "env = gymnasium.make('kitchen_suite:KitchenSuite/Kettle-v1', obs_type='state')\n"
        "env.reset(seed=0)\n"
        "env.step(env.action_space.sample())\n"
    ),
    "train": (
        "import torch\n"
        "network = torch.nn.Linear(59, 9)\n"
        "optimiser = torch.optim.Adam(network.parameters())\n"
        "network(torch.zeros(1, 59)).sum().backward()\n"
        "optimiser.step()\n"
    ),
    "image": (
        "from kitchen_suite import suite\n"
        "environment = suite.load('open_cabinet', 'top_drawer')\n"
        "assert environment.physics.render(16, 16).std() > 5\n"
    ),
    "vector": (
        "images = dict(obs_type='pixels', image_size=(16, 16), render_quality='fast')\n"
        "vector = gymnasium.make_vec('kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1', num_envs=2, **images)\n"
        "assert vector.reset(seed=0)[0].std() > 5\n"
    ),
    "video": (
        "from kitchen_suite.commands import rollout\n"
        "assert rollout.main(\n"
        "    ['--domain_name=open_cabinet', '--num_episodes=1', '--max_episode_steps=3', '--video=film.mp4']\n"
        ") == 0\n"
    ),
    "dm_control": (
        "from kitchen_suite import entities\n"
        "from dm_control import suite as others\n"
        "assert others.load('cartpole', 'swingup').physics.render(16, 16).std() > 5\n"
    ),
}

PAIRS = [order for kind in ("vector", "video", "dm_control") for order in ((kind, "train"), ("train", kind))]
ORDERS = [
    *itertools.permutations(("make", "train", "image")),
    *PAIRS,
    ("image", "dm_control", "train", "vector", "make"),
]


@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_no_order_of_training_and_images_ends_the_process(order, tmp_path):
    code = "import gymnasium\n" + "".join(STEPS[step] for step in order)
    status, _, err = run(code, folder=tmp_path)
    assert status == 0, err


def test_a_gl_library_that_other_code_opened_first_ends_no_process(tmp_path):
    opened = "import os\nos.environ['MUJOCO_GL'] = 'egl'\nfrom dm_control import mujoco\nimport gymnasium\n"
    status, _, err = run(opened + STEPS["make"] + STEPS["train"] + STEPS["image"])
    assert status == 0, err


IMPORTS = {
    "suite": "import kitchen_suite.gymnasium_env",
    "stable_baselines3": (
        "from stable_baselines3 import PPO\nfrom stable_baselines3.common.evaluation import evaluate_policy"
    ),
    "dm_control": "from dm_control import suite as others",
}

# Makes an environment, trains in it, films and evaluates what it learned.
PROGRAM = """
import gymnasium
import imageio

def make(**options):
    return gymnasium.make(
        "kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1", max_episode_steps=8, action_limit=1.0, **options
    )

model = PPO("MlpPolicy", make(obs_type="state"), n_steps=16, batch_size=16, n_epochs=1, device="cpu", seed=0)
model.learn(32)
film = make(obs_type="state", render_mode="rgb_array_list", width=64, height=64)
rewards, lengths = evaluate_policy(model, film, n_eval_episodes=1, return_episode_rewards=True, warn=False)
imageio.mimsave("film.mp4", film.render(), fps=25)
film.close()
assert lengths == [8]
model.learn(16)
assert others.load("cartpole", "swingup").physics.render(16, 16).std() > 5
"""


@pytest.mark.parametrize("order", [*itertools.permutations(IMPORTS)], ids=" ".join)
def test_a_program_makes_trains_films_and_evaluates_in_any_order_of_imports(order, tmp_path):
    code = "\n".join(("import warnings; warnings.simplefilter('ignore')", *(IMPORTS[name] for name in order), PROGRAM))
    status, _, err = run(code, folder=tmp_path)
    assert status == 0, err
    assert (tmp_path / "film.mp4").stat().st_size > 1000


def test_kitchen_train_films_beside_its_training(tmp_path):
    code = (
        "from kitchen_suite.commands import train\n"
        'small = \'{"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2}\'\n'
        "flags = ['--domain_name=open_cabinet', '--task_name=top_drawer', '--num_steps=64', '--eval_interval=64']\n"
        "flags += ['--eval_episodes=1', '--hyperparameters=' + small, '--output=run', '--video=film.mp4']\n"
        "raise SystemExit(train.main(flags))\n"
    )
    status, _, err = run(code, folder=tmp_path)
    assert status == 0, err


def test_the_doctor_names_a_clash(tmp_path):
    status, out, err = run("from kitchen_suite import doctor; print(doctor._facts()['triton beside GL'])")
    assert status == 0, err
    assert out.startswith(("clash: signal 11", "no clash", "triton is not installed"))
