"""Receipts: what `kitchen-evaluate` writes, `kitchen-replay` confirms, and every alteration is found."""

import copy
import dataclasses
import functools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import kitchen_suite
from kitchen_suite import files
from kitchen_suite.commands import evaluate, record, replay
from kitchen_suite.evaluation.evaluation import Evaluation, check_can_be_receipt
from kitchen_suite.evaluation.plan import EvaluationPlan, Replaced, make_plan
from kitchen_suite.evaluation.receipt import Receipt, sealed
from kitchen_suite.evaluation.rollout import watch_episodes
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.vector_env import base as vector_base
from kitchen_suite.versions import installed_versions, machine

pytestmark = pytest.mark.usefixtures("folder")

SMALL = ["--num_episodes=3", "--max_episode_steps=12"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A receipt of some short episodes of the expert, under a protocol with a published score."""
    path = tmp_path_factory.mktemp("receipt") / "receipt.npz"
    flags = ["--policy=expert", "--protocol=d4rl", "--num_envs=3", f"--receipt={path}"]
    assert evaluate.main([*SMALL, *flags]) == 0
    return path


@pytest.mark.full
@pytest.mark.parametrize(
    "flags",
    [
        ["--policy=expert", "--variations=start,layout,push"],
        ["--domain_name=open_cabinet", "--policy=zero", "--physics=exact"],
        pytest.param(["--domain_name=microwave_table", "--policy=random", "--physics=fast"], marks=pytest.mark.full),
        pytest.param(["--protocol=diffusion-policy", "--policy=random"], marks=pytest.mark.full),
        # Every episode ends with a reward, which is not that of the next one's reset.
        ["--policy=zero", "--task_name=kettle", '--task_kwargs={"threshold": 10}'],
    ],
    ids=str,
)
def test_a_receipt_is_confirmed_without_the_policy(run, flags):
    assert run(evaluate, *SMALL, *flags, "--receipt=a.npz", "--json=a.json")[0] == 0
    receipt = Receipt.read(files.Path("a.npz"))
    assert receipt.evaluation == json.loads(files.Path("a.json").read_text("utf-8"))
    for numbers in (["--num_envs=1"], ["--num_envs=2", "--num_threads=2"]):
        status, out, err = run(replay, "a.npz", *numbers)
        assert (status, err) == (0, "")
        assert out.endswith("the receipt holds: all numbers are equal to the bit, and all scores follow from them\n")
    first, *lines = out.splitlines()
    assert "; values replaced: num_episodes 3, not " in first
    assert "; max_episode_steps 12, not " in first
    assert any(line.startswith("versions: ") and "mujoco " in line for line in lines)
    assert sum("95 % interval" in line for line in lines) >= len(receipt.results)


@pytest.mark.full
def test_the_policy_may_be_gone(run, tmp_path):
    source = tmp_path / "gone.npz"
    from kitchen_suite.policies.files import shipped_as

    source.write_bytes(shipped_as("kettle").read_bytes())
    flags = ["--policy=trained(file='gone.npz')", "--task_name=kettle", "--receipt=a.npz"]
    assert run(evaluate, *SMALL, *flags)[0] == 0
    source.unlink()
    assert run(replay, "a.npz")[0] == 0


@pytest.mark.full
@pytest.mark.rendering
def test_a_replay_needs_no_pictures(run):
    kwargs = {"obs_type": "pixels_agent_pos", "image_size": [8, 8], "cameras": ["workspace"]}
    flags = ["--policy=random", f"--task_kwargs={json.dumps(kwargs)}", "--receipt=a.npz"]
    assert run(evaluate, *SMALL, *flags)[0] == 0
    script = "import sys; from kitchen_suite.commands import replay; sys.exit(replay.main(['a.npz']))"
    without = {**os.environ, "MUJOCO_GL": "disable"}
    assert subprocess.run([sys.executable, "-c", script], env=without, check=False).returncode == 0


@pytest.mark.full
def test_a_receipt_holds_the_goals_that_were_taken_from_a_recording(run, tmp_path):
    playing = ["--policy=expert", "--task_name=random_4", "--max_episode_steps=60"]
    for seed in (0, 1):
        assert run(record, f"--output=runs{seed}", *playing, "--num_episodes=1", f"--seed={seed}")[0] == 0
    flags = ["--policy=expert", "--protocol=beso", "--output=out"]
    assert run(evaluate, *SMALL, *flags, "--dataset=runs0", "--receipt=a.npz")[0] == 0
    # Other goals are another evaluation.
    status, _, err = run(evaluate, *SMALL, *flags, "--dataset=runs1", "--resume")
    assert status == 2
    assert "goals_sha256" in err
    status, out, _ = run(replay, "a.npz", "--dataset=runs0")
    assert (status, "the goals are those of runs0" in out.splitlines()[0]) == (0, True)
    shutil.rmtree("runs0")
    status, out, _ = run(replay, "a.npz")
    assert status == 0
    assert "not verified, since their recording is not here: where the goals were taken from" in out.splitlines()[0]
    status, _, err = run(replay, "a.npz", "--dataset=runs1")
    assert (status, "are not those that their seeds take from runs1" in err) == (1, True)

    receipt = Receipt.read(tmp_path / "a.npz")
    resets = [result.reset for result in receipt.results["goals"]]
    assert [*resets[0]] == ["requested_tasks", "goal_states"]

    def forge(changed):
        """Writes the receipt with other goals, and all that follows from them."""
        results = {
            "goals": [
                dataclasses.replace(one, reset=new) for one, new in zip(receipt.results["goals"], changed, strict=True)
            ]
        }
        given = {"goals": changed} if any(changed) else None
        plan = EvaluationPlan.of(receipt.evaluation, given)
        anew = Evaluation(plan=plan, results=results).as_json()
        dataclasses.replace(receipt, evaluation=anew, results=results).write(tmp_path / "b.npz")

    moved = copy.deepcopy(resets)
    moved[1]["goal_states"][0][3] += 1e-9
    forge(moved)
    assert run(replay, "b.npz")[0] == 3
    others = copy.deepcopy(resets)
    others[2]["requested_tasks"] = [task for task in DEFAULT_TASKS if task not in others[2]["requested_tasks"]][:1]
    forge(others)
    assert run(replay, "b.npz")[0] == 1
    tasks, states = resets[0]["requested_tasks"], resets[0]["goal_states"]
    for broken in (
        {},
        {"goal_states": states},
        {"requested_tasks": tasks, "goal_states": [[0.0] * 30]},
        {"requested_tasks": tasks, "goal_states": [[float("nan")] * 30] * 2},
        {**resets[0], "state": {}},
        {**resets[0], "start_state": states[-1]},
        {**resets[0], "task_id": 1},
    ):
        with pytest.raises(ValueError, match=r"goal|option"):
            forge([broken, *resets[1:]])
        arrays, metadata = contents_of(receipt, tmp_path / "a.npz")
        metadata["episodes"]["goals"][0]["reset"] = broken
        # Some of it is no JSON that the suite writes.
        sealed_with(tmp_path / "b.npz", arrays, metadata)
        status, _, err = run(replay, "b.npz")
        assert (status, err.count("\n")) == (1, 1)


@pytest.mark.full
def test_an_interrupted_evaluation_has_the_same_receipt(run, tmp_path):
    flags = ["--policy=expert", "--num_envs=1"]
    assert run(evaluate, *SMALL, *flags, "--receipt=whole.npz", "--output=whole")[0] == 0
    episodes = tmp_path / "whole" / "episodes.jsonl"
    episodes.write_bytes(episodes.read_bytes().split(b"\n")[0] + b"\n")
    assert run(evaluate, *SMALL, *flags, "--receipt=again.npz", "--output=whole", "--resume")[0] == 0
    one, other = (Receipt.read(tmp_path / f"{name}.npz") for name in ("whole", "again"))
    assert (one.evaluation, one.results) == (other.evaluation, other.results)
    for each, same in zip(one.traces["random_4"], other.traces["random_4"], strict=True):
        assert each.first_difference(same) is None
        np.testing.assert_array_equal(each.actions, same.actions)


@pytest.mark.full
def test_a_diverged_episode_is_replayed(run, monkeypatch):
    step = vector_base.SuiteVectorEnv.step_some

    def diverge(self, actions, mask):
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = mask & (self._episodes.steps == 5) & (actions[:, 0] > 0)
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(vector_base.SuiteVectorEnv, "step_some", diverge)
    assert run(evaluate, *SMALL, "--num_episodes=6", "--receipt=a.npz")[0] == 0
    receipt = Receipt.read(files.Path("a.npz"))
    lengths = [len(trace.actions) for trace in receipt.traces["random_4"]]
    assert {*lengths} == {5, 12}
    assert [result.diverged for result in receipt.results["random_4"]] == [length == 5 for length in lengths]
    assert run(replay, "a.npz")[0] == 0


@pytest.mark.full
def test_the_format_is_read_as_documented(written):
    """By NumPy and the standard library, from the docstring of `receipts`."""
    import hashlib
    import zipfile

    contents = written.read_bytes()
    with zipfile.ZipFile(written) as archive:
        assert archive.comment.decode() == hashlib.sha256(contents[:-64]).hexdigest()
    arrays = np.load(written)
    metadata = json.loads(str(arrays["metadata"]))
    assert metadata["format"] == 2
    receipt = Receipt.read(written)
    for name, episodes in metadata["episodes"].items():
        steps = arrays[f"{name}/steps"]
        actions = np.ascontiguousarray(arrays[f"{name}/actions"].transpose(2, 1, 0)).view("<f4")[..., 0]
        assert actions.shape == (steps.sum(), 9)
        assert arrays[f"{name}/checks"].shape == (steps.sum() + steps.size,)
        assert len(episodes) == steps.size == 3
        np.testing.assert_array_equal(actions[: steps[0]], receipt.traces[name][0].actions)


@pytest.mark.full
def test_digests_are_those_of_observations_and_rewards(written):
    """The digest of an episode, from the suite's own environment."""
    import hashlib

    from kitchen_suite.gymnasium_env.base import suite_env

    receipt = Receipt.read(written)
    spec = EvaluationPlan.of(receipt.evaluation).first
    trace, environment = receipt.traces["complete"][1], spec.make_environment()
    environment.reset(seed=spec.seed + 1)
    rows = [np.concatenate([[0.0], *map(np.ravel, suite_env(environment).present_observation.values())])]
    for action in trace.actions:
        reward = environment.step(action)[1]
        rows.append(np.concatenate([[reward], *map(np.ravel, suite_env(environment).present_observation.values())]))
    assert hashlib.sha256(np.stack(rows).astype("<f8").tobytes()).digest() == trace.digest.tobytes()
    begun = [hashlib.sha256(np.stack(rows[: step + 1]).astype("<f8").tobytes()).digest() for step in range(len(rows))]
    assert [int.from_bytes(digest[:2], "little") for digest in begun] == trace.checks.tolist()
    np.testing.assert_array_equal(trace.last, rows[-1].astype(np.float32))


@pytest.mark.full
def test_every_changed_byte_is_found(written):
    contents, generator = bytearray(written.read_bytes()), np.random.default_rng(0)
    target = written.with_name("changed.npz")
    for _ in range(1_000):
        changed = bytearray(contents)
        place = int(generator.integers(len(changed)))
        changed[place] ^= int(generator.integers(1, 256))
        target.write_bytes(changed)
        with pytest.raises(OSError, match="does not hold a receipt"):
            Receipt.read(target)


@pytest.mark.full
def test_bad_files_are_refused(run, written):
    assert run(replay, "nothing.npz")[0] == 2
    files.Path("text.npz").write_text("a receipt")
    assert run(replay, "text.npz")[0] == 1
    with np.load(written) as file:
        arrays = dict(file)
    metadata = json.loads(str(arrays["metadata"]))
    for change in ({"format": 1}, {"episodes": 3}, {"replaced": ["seed"]}, {"episodes": {}}):
        altered = {**arrays, "metadata": np.array(json.dumps({**metadata, **change}))}
        files.Path("b.npz").write_bytes(sealed(files.pack_arrays(altered)))
        status, _, err = run(replay, "b.npz")
        assert status == 1
        assert err.count("\n") == 1
    module = copy.deepcopy(metadata)
    module["evaluation"]["domain_name"] = "os:system"
    files.Path("b.npz").write_bytes(sealed(files.pack_arrays({**arrays, "metadata": np.array(json.dumps(module))})))
    status, _, err = run(replay, "b.npz")
    assert status == 1
    assert "domain" in err


class Forger:
    """Alters a receipt, and makes all that follows from the alteration anew, as its format says.

    Only what a simulation alone could tell is left as it was.
    """

    def __init__(self, receipt, seed):
        self.receipt, self.generator = receipt, np.random.default_rng(seed)

    def written(self, path, **changes):
        dataclasses.replace(self.receipt, **changes).write(path)

    def action(self, path):
        """Another number of an action, with effect: one of the arm's joints is moved otherwise.

        Not the second one, which is at the lower end of its range, where velocities below 0 have the same target.
        """
        name = self.generator.choice([*self.receipt.traces])
        traces = list(self.receipt.traces[name])
        index = int(self.generator.integers(len(traces)))
        actions = traces[index].actions.copy()
        step, joint = int(self.generator.integers(len(actions))), int(self.generator.choice([0, 2, 3, 4, 5, 6]))
        old = actions[step, joint]
        actions[step, joint] = old + 0.1 if old < 0.5 else old - 0.1
        traces[index] = dataclasses.replace(traces[index], actions=actions)
        self.written(path, traces={**self.receipt.traces, name: traces})

    def seed(self, path):
        """Other seeds of all episodes."""
        shift = int(self.generator.integers(1, 10**6))
        moved = {
            name: [dataclasses.replace(result, seed=result.seed + shift) for result in results]
            for name, results in self.receipt.results.items()
        }
        evaluation = copy.deepcopy(self.receipt.evaluation)
        evaluation["seed"] += shift
        self.written_anew(path, evaluation, moved)

    def score(self, path):
        """Another result of an episode, and the scores that follow from it."""
        name = self.generator.choice([*self.receipt.results])
        results = list(self.receipt.results[name])
        index = int(self.generator.integers(len(results)))
        one = results[index]
        task = self.generator.choice([*one.asked])
        reached = not one.success
        changes = [
            {"success": reached, "success_at_end": reached, "steps_to_success": 1 if reached else None},
            {"control_steps": one.control_steps + int(self.generator.integers(1, 50))},
            {"asked": {**one.asked, task: None if one.asked[task] else int(self.generator.integers(1, 12))}},
            {"progress": one.progress + 0.25},
            {"diverged": True},
        ]
        results[index] = dataclasses.replace(one, **changes[int(self.generator.integers(len(changes)))])
        evaluation = copy.deepcopy(self.receipt.evaluation)
        self.written_anew(path, evaluation, {**self.receipt.results, name: results})

    def setting(self, path):
        """Another setting of the environments."""
        evaluation = copy.deepcopy(self.receipt.evaluation)
        changes = [
            {"robot_noise_ratio": round(float(self.generator.uniform(0.02, 1.0)), 6)},
            {"object_noise_ratio": round(float(self.generator.uniform(0.0, 1.0)), 6)},
            {"control_mode": "joint_position"},
            {"variations": ["layout"]},
            {"physics": "fast"},
            {"reward": "dense"},
        ]
        change = changes[int(self.generator.integers(len(changes)))]
        for condition in evaluation["conditions"].values():
            condition["task_kwargs"] = {**condition["task_kwargs"], **change}
        if self.generator.random() < 0.2:
            evaluation = {**copy.deepcopy(self.receipt.evaluation)}
            evaluation["max_episode_steps"] -= int(self.generator.integers(1, 11))
        self.written_anew(path, evaluation, self.receipt.results)

    def written_anew(self, path, evaluation, results):
        """Writes a receipt whose scores and list of replaced values follow from its settings and results."""
        plan = EvaluationPlan.of(evaluation)
        anew = Evaluation(plan=plan, results=results).as_json()
        self.written(path, evaluation=anew, results=results, replaced=plan.replaced)


def check_alterations(receipt, folder, numbers):
    """Asserts that `kitchen-replay` confirms none of the alterations of some numbers."""
    path, kinds = folder / "forged.npz", ("action", "seed", "score", "setting")
    for number in numbers:
        forger = Forger(receipt, number)
        getattr(forger, kinds[number % len(kinds)])(path)
        assert replay.main([str(path), "--num_threads=1"]) in (1, 3), number


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A receipt of few steps, which is quickly verified."""
    path = tmp_path_factory.mktemp("short") / "receipt.npz"
    flags = ["--policy=expert", "--num_episodes=2", "--max_episode_steps=12", "--num_envs=2", f"--receipt={path}"]
    assert evaluate.main(flags) == 0
    assert replay.main([str(path)]) == 0
    return Receipt.read(path)


@pytest.mark.full
def test_alterations_with_recomputed_digests_are_found(short, tmp_path, capsys):
    check_alterations(short, tmp_path, range(8))


@pytest.mark.full
@pytest.mark.parametrize("part", range(2))
def test_two_hundred_alterations_are_found(short, tmp_path, capsys, part):
    check_alterations(short, tmp_path, range(part, 200, 2))


@pytest.mark.nightly
@pytest.mark.parametrize("part", range(8))
def test_a_thousand_alterations_are_found(short, tmp_path, capsys, part):
    check_alterations(short, tmp_path, range(200 + part, 1_000, 8))


@pytest.mark.full
def test_other_digits_and_other_scores_are_told_apart(run, short, tmp_path):
    path = tmp_path / "b.npz"
    Forger(short, 0).action(path)
    status, out, err = run(replay, "b.npz")
    assert (status, err) == (3, "")
    assert "the scores hold, but not all digits" in out
    assert "numbers differ from control step" in out
    Forger(short, 1).score(path)
    status, out, err = run(replay, "b.npz")
    assert (status, err) == (1, "")
    assert "the scores are not those of the replay" in out
    # What a replay cannot find: the name of the policy, and a version, which is said to be another one here.
    evaluation = copy.deepcopy(short.evaluation)
    evaluation["versions"]["mujoco"] = "1.2.3"
    dataclasses.replace(short, evaluation={**evaluation, "policy": "mine:act"}).write(path)
    status, out, err = run(replay, "b.npz")
    assert (status, err) == (0, "")
    assert "policy mine:act" in out
    assert "made with mujoco 1.2.3, here " in out


@pytest.mark.full
def test_names_of_a_receipt_may_be_any(short, tmp_path):
    named = functools.partial(dataclasses.replace, condition="layout held_out")
    results = {"layout held_out": [named(result) for result in short.results["random_4"]]}
    traces = {"layout held_out": short.traces["random_4"]}
    dataclasses.replace(short, results=results, traces=traces).write(tmp_path / "a.npz")
    assert Receipt.read(tmp_path / "a.npz").results == results


COMMITTED = sorted(Path(__file__).parents[2].glob("docs/experiments/results/receipts/*.npz"))

# Small ones, which the full run replays.
QUICK = ("expert_gas", "trained_gas")


@pytest.mark.full
def test_committed_receipts_are_of_the_committed_results():
    assert {path.stem for path in COMMITTED} >= {*QUICK}
    for path in COMMITTED:
        receipt = Receipt.read(path)
        result = json.loads((path.parents[1] / "evaluation" / f"{path.stem}.json").read_text("utf-8"))
        assert receipt.evaluation == result, path
        assert receipt.replaced == [], path
        assert Evaluation.read(path).plan.protocol == path.stem.rpartition("_")[2]


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.full if path.stem in QUICK else pytest.mark.nightly)
        for path in COMMITTED
    ],
)
def test_committed_receipts_are_confirmed(path, capsys):
    receipt, here = Receipt.read(path), {**installed_versions(), "processor": machine()}
    same = here == {**receipt.evaluation["versions"], "processor": receipt.machine}
    status = replay.main([str(path)])
    # Elsewhere numbers are rounded otherwise, which contacts multiply.
    assert status == 0 if same else status in (0, 1, 3)


def sealed_with(path, arrays, metadata):
    path.write_bytes(sealed(files.pack_arrays({**arrays, "metadata": np.array(json.dumps(metadata))})))


def contents_of(receipt, path):
    """Arrays and metadata of a receipt, which is written to a path."""
    receipt.write(path)
    with np.load(path) as file:
        arrays = dict(file)
    return arrays, json.loads(str(arrays.pop("metadata")))


@pytest.fixture
def opened(short, tmp_path):
    """The arrays and the metadata of a short receipt."""
    return contents_of(short, tmp_path / "opened.npz")


REFUSED = {
    "episodes": lambda arrays, data: data["evaluation"].update(num_episodes=10**12),
    "fewer episodes": lambda arrays, data: data["evaluation"].update(num_episodes=10**5),
    "steps": lambda arrays, data: data["evaluation"].update(max_episode_steps=11),
    "control steps": lambda arrays, data: data["episodes"]["random_4"][0].update(control_steps=10**400),
    "measures": lambda arrays, data: data["episodes"]["random_4"][0].update(measures={"x": 1.0}),
    "infinite": lambda arrays, data: data["episodes"]["random_4"][0].update(progress=1e999),
    "no tasks": lambda arrays, data: [each.update(asked={}) for each in data["episodes"]["random_4"]],
    "an escape": lambda arrays, data: data["evaluation"].update(policy="x\x1b[2J"),
    "a long name": lambda arrays, data: data["evaluation"].update(policy="x" * 10_000),
    "types": lambda arrays, data: data["evaluation"].update(p1=False),
    "no conditions": lambda arrays, data: (data["evaluation"].update(conditions={}), data.update(episodes={})),
    "an array": lambda arrays, data: arrays.update(further=np.zeros(3)),
    "dimensions": lambda arrays, data: arrays.update({"random_4/last": np.zeros((2, 3, 4), np.float32)}),
    "NaN": lambda arrays, data: arrays.update({"random_4/actions": np.full_like(arrays["random_4/actions"], 255)}),
}


@pytest.mark.full
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", REFUSED)
def test_what_makes_no_sense_is_refused_in_one_line(run, opened, tmp_path, kind):
    arrays, metadata = opened
    REFUSED[kind](arrays, metadata)
    sealed_with(tmp_path / "b.npz", arrays, metadata)
    status, out, err = run(replay, "b.npz")
    assert status == 1
    assert err.count("\n") == 1
    assert "\x1b" not in out + err


FACTS = {
    "a name": lambda data: data["evaluation"]["versions"].update({"confirmed by": "MuJoCo"}),
    "a version": lambda data: data["evaluation"]["versions"].update({"mujoco": "3.17, and confirmed by its authors"}),
    "no version": lambda data: data["evaluation"]["versions"].update({"numpy": ""}),
    "an arm": lambda data: data["evaluation"]["versions"].update({"robot my_arm:MY_ARM": "0" * 16}),
    "a machine": lambda data: data.update(machine="any, and the scores are those of the paper"),
}


@pytest.mark.full
@pytest.mark.parametrize("kind", FACTS)
def test_words_of_a_receipt_are_not_shown_as_facts(run, opened, tmp_path, kind):
    arrays, metadata = opened
    FACTS[kind](metadata)
    sealed_with(tmp_path / "b.npz", arrays, metadata)
    status, out, err = run(replay, "b.npz")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "versions" in err or "version of" in err or "machine" in err


@pytest.mark.full
def test_a_receipt_of_a_protocol_that_is_gone_says_so(run, opened, tmp_path):
    arrays, metadata = opened
    metadata["evaluation"].update(protocol="metra")
    sealed_with(tmp_path / "b.npz", arrays, metadata)
    status, _, err = run(replay, "b.npz")
    assert status == 1
    assert "'metra', which this version of the suite does not have" in err
    assert "'default'" in err


def test_versions_of_packages_are_read():
    plan = make_plan(PolicyRef.parse("zero"), "default", Replaced(num_episodes=1))
    versions = {"kitchen-suite": "1.1.0.dev3+g12ab", "mujoco": "3.3.8"}
    assert EvaluationPlan.of({**plan.description, "versions": versions}).first.versions == versions


@pytest.mark.full
def test_a_receipt_of_episodes_without_actions_is_refused(run, tmp_path):
    """The remedy is the one that the message names."""
    arguments = {"num_episodes": 2, "max_episode_steps": 3, "num_envs": 2}
    kitchen_suite.evaluate("zero", **arguments).write(tmp_path / "a.json")
    without = Evaluation.read(tmp_path / "a.json")
    for use in (without.check, lambda: without.write(tmp_path / "a.npz")):
        with pytest.raises(ValueError, match="evaluate with receipt, the path to write to, and read that"):
            use()
    assert not (tmp_path / "a.npz").exists()
    evaluation = kitchen_suite.evaluate("zero", **arguments, receipt=tmp_path / "a.npz")
    evaluation.write(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert run(replay, "b.npz")[0] == 0


@pytest.mark.full
@pytest.mark.parametrize("part", ["checks", "last"])
def test_every_array_is_compared(run, opened, tmp_path, part):
    arrays, metadata = opened
    arrays[f"random_4/{part}"][0] += 1
    sealed_with(tmp_path / "b.npz", arrays, metadata)
    assert run(replay, "b.npz")[0] == 3


@pytest.mark.full
def test_conditions_keep_their_names(run, tmp_path):
    path = tmp_path / "a.npz"
    assert evaluate.main([*SMALL, "--protocol=d4rl", "--num_episodes=1", f"--receipt={path}"]) == 0
    receipt = Receipt.read(path)
    other = {"complete": "partial", "partial": "complete"}
    conditions = {other.get(name, name): entry for name, entry in receipt.evaluation["conditions"].items()}
    results = {
        other.get(name, name): [dataclasses.replace(each, condition=other.get(name, name)) for each in results]
        for name, results in receipt.results.items()
    }
    traces = {other.get(name, name): each for name, each in receipt.traces.items()}
    evaluation = {**receipt.evaluation, "conditions": conditions}
    dataclasses.replace(receipt, evaluation=evaluation, results=results, traces=traces).write(path)
    status, _, err = run(replay, "a.npz")
    assert status == 1
    assert "'partial' is no condition of protocol 'd4rl' with the task 'complete'" in err


@pytest.mark.full
def test_an_episode_that_goes_on_is_not_played_to_its_end(run, short, tmp_path):
    """Of episodes with 12 actions, under a limit of 100,000 control steps."""
    evaluation = copy.deepcopy(short.evaluation)
    evaluation["max_episode_steps"] = 100_000
    Forger(short, 0).written_anew(tmp_path / "b.npz", evaluation, short.results)
    status, out, _ = run(replay, "b.npz")
    assert status == 1
    assert "control_steps 12, replayed 13" in out


@pytest.mark.full
def test_a_receipt_does_not_import_the_robot_that_it_names(short, tmp_path, monkeypatch):
    (tmp_path / "planted.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    evaluation = copy.deepcopy(short.evaluation)
    for condition in evaluation["conditions"].values():
        condition["task_kwargs"] = {"robot": "planted:ARM", "control_mode": "ee_pose"}
    with pytest.raises(ValueError, match="robot of a receipt"):
        EvaluationPlan.of(evaluation)


@pytest.mark.full
def test_a_receipt_that_could_not_be_verified_is_refused_at_the_start(run, tmp_path, monkeypatch):
    (tmp_path / "planted.py").write_text("from kitchen_suite.entities import PANDA as ARM\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for flags, shown in (
        (["--num_episodes=60000"], "50,000 episodes"),
        (["--num_episodes=40000"], "10,000,000 control steps"),
        (["--domain_name=kitchen_suite.domains.kitchen:KITCHEN"], "could not be verified"),
        (['--task_kwargs={"robot": "planted:ARM", "control_mode": "ee_pose"}'], "robot of a receipt"),
    ):
        status, _, err = run(evaluate, *flags, "--receipt=a.npz")
        assert status == 2
        assert shown in err
    assert not os.path.exists("a.npz")


@pytest.mark.full
def test_a_receipt_of_many_episodes_is_read_and_one_of_too_many_goals_is_refused_at_the_start(short, tmp_path):
    one = dataclasses.replace(short.results["random_4"][0], reset={"a": "x" * 1_000, "b": "y" * 1_000})
    results, traces = {"random_4": [one] * 10_000}, {"random_4": [short.traces["random_4"][0]] * 10_000}
    dataclasses.replace(short, results=results, traces=traces).write(tmp_path / "many.npz")
    assert Receipt.read(tmp_path / "many.npz").results == results
    plan = make_plan(PolicyRef.parse("zero"), replaced=Replaced(num_episodes=30_000))
    check_can_be_receipt(plan)
    goals = {"random_4": [{"goal_states": [0.1] * 400}] * 30_000}
    with pytest.raises(ValueError, match="fewer with goals"):
        check_can_be_receipt(dataclasses.replace(plan, resets=goals))


@pytest.mark.full
def test_a_bad_argument_is_not_an_altered_receipt(written):
    with pytest.raises(ValueError, match="num_envs"):
        kitchen_suite.replay(written, num_envs=0)
    with pytest.raises(ValueError, match="num_threads"):
        kitchen_suite.replay(written, num_threads=0)
    with pytest.raises(ValueError, match="all together"):
        kitchen_suite.replay(written, episodes="0,1")


@pytest.mark.full
def test_the_episodes_of_a_page_are_those_that_were_evaluated():
    seen = []
    evaluation = kitchen_suite.evaluate("random", num_episodes=2, max_episode_steps=5)
    watch_episodes(
        evaluation.plan,
        evaluation.results,
        evaluation.traces,
        2,
        lambda buffer, environment: seen.append(buffer.observation),
    )
    spec = evaluation.plan.first
    played = kitchen_suite.play(spec, "random", range(spec.seed, spec.seed + 2))
    for place, episode in enumerate(sorted(played, key=lambda episode: episode.index)):
        rows = [observation["observation"] for observation in seen[6 * place : 6 * (place + 1)]]
        np.testing.assert_array_equal(rows, episode.arrays["observation/observation"])
