"""The board: its page follows from its rows, and forged rows are refused with the reason."""

import copy
import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from docs_scripts import DOCS, load_script

import kitchen_suite
from kitchen_suite import files
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.receipt import Receipt, sealed

BOARD = DOCS / "board"

# The rows of the tests, with receipts of one protocol: the first is forged, the second is left as it is.
FORGED = "kitchen_clone"
OTHER = "random"
PROTOCOL = "clean"
CONDITION = "random_4"
POLICY = "trained"


@pytest.fixture(scope="module")
def make():
    return load_script("board/make")


@pytest.fixture
def board(tmp_path):
    """A board of two rows of the true one, which knows their receipts."""
    folder = tmp_path / "board"
    for name in (FORGED, OTHER):
        (folder / name).mkdir(parents=True)
        shutil.copy(BOARD / name / f"{PROTOCOL}.npz", folder / name)
        stated = json.loads((BOARD / name / "row.json").read_text(encoding="utf-8"))
        files.write_json(folder / name / "row.json", {**stated, "receipts": {PROTOCOL: stated["receipts"][PROTOCOL]}})
    shutil.copy(BOARD / "replayed.json", folder)
    return folder


@pytest.fixture(scope="module")
def spare():
    """Episodes of the forged row's policy from other seeds, of which a forger may choose."""
    return kitchen_suite.evaluate(POLICY, protocol=PROTOCOL, seed=410_000_000, num_episodes=4, num_envs=4)


def test_the_page_follows_from_the_rows_to_the_byte(make, tmp_path):
    folder = tmp_path / "board"
    shutil.copytree(BOARD, folder)
    target = tmp_path / "board.md"
    known = json.loads((BOARD / "replayed.json").read_text(encoding="utf-8"))
    assert make.main([], folder, target) == 0, "run: python docs/board/make.py"
    assert target.read_bytes() == make.PAGE.read_bytes(), "run: python docs/board/make.py"
    # No receipt was replayed.
    assert json.loads((folder / "replayed.json").read_text(encoding="utf-8")) == known


def test_every_protocol_of_the_board_has_rows(make):
    text = make.PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## `(.+)`$", text, re.MULTILINE) == [*make.rows.BOARDS]
    assert "no row yet" not in text


def test_rows_are_in_the_order_of_the_score(make):
    rows = make.rows.read_rows(BOARD)
    for protocol, board in make.rows.BOARDS.items():
        listed = make.page.ranking(protocol, rows)
        scores = [row.receipts[protocol].evaluation.scores[board.score] for row in listed]
        assert scores == sorted(scores, reverse=True)
        first, *others = make.page.differences_from_best([row.receipts[protocol] for row in listed], board.score)
        assert first is None
        for score, difference in zip(scores[1:], others, strict=True):
            assert difference.difference == pytest.approx(score - scores[0], abs=1e-5)


def test_a_row_that_is_not_known_is_replayed(make, board, tmp_path, capsys):
    files.write_json(board / "replayed.json", {})
    shutil.rmtree(board / OTHER)
    make.main([], board, tmp_path / "page.md")
    assert capsys.readouterr().out.splitlines() == [f"replaying {FORGED}/{PROTOCOL}.npz"]


@pytest.mark.parametrize(
    "change",
    [
        {"title": "a | b"},
        {"link": "javascript:alert(1)"},
        {"commands": ["```\n# Heading"]},
        {"cost": "two\nlines"},
        {"observes": ["touch"]},
        {"receipts": {}},
        {"receipts": {PROTOCOL: "0"}},
        {"stars": 5},
    ],
    ids=str,
)
def test_a_statement_of_another_form_is_refused(make, board, tmp_path, capsys, change):
    state(board, **change)
    assert_refused(make, board, tmp_path, capsys, "not a row: ")


def test_a_receipt_of_a_protocol_that_the_board_has_not_is_refused(make, board, tmp_path, capsys):
    (board / FORGED / f"{PROTOCOL}.npz").rename(board / FORGED / "default.npz")
    state(board, receipts={"default": stated(board)["receipts"][PROTOCOL]})
    assert_refused(make, board, tmp_path, capsys, "protocol of the board 'default' does not exist")


def test_two_rows_of_one_title_are_refused(make, board, tmp_path, capsys):
    title = json.loads((board / OTHER / "row.json").read_text(encoding="utf-8"))["title"]
    state(board, title=title)
    assert make.main([], board, tmp_path / "page.md") == 1
    assert capsys.readouterr().err == f"refused: {OTHER}: the row {FORGED} has the same title\n"


def test_markup_in_a_row_stays_text(make, board):
    state(board, cost="<b>1</b> | [hour](x)")
    text, _ = make.make(board, json.loads((board / "replayed.json").read_text(encoding="utf-8")))
    assert "<b>" not in text
    assert "](x)" not in text


def stated(board):
    """The statements of the forged row."""
    return json.loads((board / FORGED / "row.json").read_text(encoding="utf-8"))


def state(board, **changes):
    """Changes what the forged row states."""
    files.write_json(board / FORGED / "row.json", {**stated(board), **changes})


def assert_refused(make, board, tmp_path, capsys, reason):
    """Asserts that the board is refused in one line that names the row and the reason, and no page is written."""
    target = tmp_path / "page.md"
    assert make.main([], board, target) == 1
    assert not target.exists()
    error = capsys.readouterr().err
    assert re.fullmatch(rf"refused: {FORGED}: .*(?:{reason}).*\n", error), error


class Forger:
    """Forges the receipt of a row; all that follows from the forgery is made anew, and the file is sealed.

    Each kind returns the reason for which it has to be refused.
    """

    def __init__(self, board, spare, number):
        self.board = board
        self.spare = spare
        self.generator = np.random.default_rng(number)
        self.path = board / FORGED / f"{PROTOCOL}.npz"
        self.receipt = Receipt.read(self.path)
        self.results = list(self.receipt.results[CONDITION])
        self.traces = list(self.receipt.traces[CONDITION])
        # Among the first episodes, which are replayed at once.
        self.index = int(self.generator.integers(len(self.results) if number >= NIGHTLY.start else 16))

    def choice(self, *kinds):
        """Calls one of several functions, and returns what it does."""
        return kinds[int(self.generator.integers(len(kinds)))]()

    def write(self, evaluation=None):
        """Writes the receipt, with scores and replaced values that follow from its settings and results."""
        given = copy.deepcopy(self.receipt.evaluation) if evaluation is None else evaluation
        plan = EvaluationPlan.of(given)
        results = {CONDITION: self.results}
        anew = Evaluation(plan=plan, results=results).as_json()
        changes = {"evaluation": anew, "results": results, "replaced": plan.replaced}
        dataclasses.replace(self.receipt, traces={CONDITION: self.traces}, **changes).write(self.path)

    def put(self, index, result, trace):
        """Puts an episode in the place of another one."""
        seed = self.results[index].seed
        self.results[index] = dataclasses.replace(result, episode=index, seed=seed)
        self.traces[index] = trace

    def other_seeds(self):
        """All episodes are of other seeds, and say so."""
        evaluation = copy.deepcopy(self.receipt.evaluation)
        shift = int(self.generator.integers(1, 10**6))
        self.results = [dataclasses.replace(each, seed=each.seed + shift) for each in self.results]
        evaluation["seed"] += shift
        self.write(evaluation)
        return "replaces the protocol's seed"

    def chosen_episodes(self):
        """A failure is replaced by an episode of another seed; or failures are left out."""

        def replaced():
            place = int(self.generator.integers(4))
            self.put(self.index, self.spare.results[CONDITION][place], self.spare.traces[CONDITION][place])
            self.write()
            return f"the replay of episode {self.index} of {CONDITION} differs"

        def left_out():
            count = len(self.results) - int(self.generator.integers(1, 50))
            order = sorted(range(len(self.results)), key=lambda place: not self.results[place].success)[:count]
            chosen = [(self.results[place], self.traces[place]) for place in sorted(order)]
            for place, (result, trace) in enumerate(chosen):
                self.put(place, result, trace)
            self.results = self.results[:count]
            self.traces = self.traces[:count]
            self.write({**copy.deepcopy(self.receipt.evaluation), "num_episodes": count})
            return "replaces the protocol's num_episodes"

        return self.choice(replaced, left_out)

    def altered_actions(self):
        """Another number of an action; not that of the second joint, which is at the lower end of its range."""
        actions = self.traces[self.index].actions.copy()
        step = int(self.generator.integers(len(actions)))
        joint = int(self.generator.choice([0, 2, 3, 4, 5, 6]))
        actions[step, joint] += 0.1 if actions[step, joint] < 0.5 else -0.1
        self.traces[self.index] = dataclasses.replace(self.traces[self.index], actions=actions)
        self.write()
        return f"the replay of episode {self.index} of {CONDITION} differs"

    def another_protocol(self):
        """The receipt is of another protocol; its name may be that of the board's."""

        def renamed():
            protocol = str(self.generator.choice(["default", "strict", "random-4"]))
            self.write({**copy.deepcopy(self.receipt.evaluation), "protocol": protocol})
            return f"it is of protocol {protocol}"

        def swapped():
            shutil.copy(BOARD / "open_clone" / "unseen-kitchens.npz", self.path)
            return "it is of protocol unseen-kitchens"

        return self.choice(renamed, renamed, swapped)

    def another_policy(self):
        """Name or digest of the policy are not the row's."""
        digest = self.generator.bytes(32).hex()

        def name_of_row():
            state(self.board, policy=str(self.generator.choice(["expert", "gym:mine:act", "random"])))
            return f"its policy is '{POLICY}', not the row's"

        def name_of_receipt():
            policy = str(self.generator.choice(["expert", "gym:mine:act", "random"]))
            self.write({**copy.deepcopy(self.receipt.evaluation), "policy": policy})
            return f"its policy is '{policy}', not the row's"

        def digest_of_row():
            state(self.board, receipts={PROTOCOL: digest})
            return f"the SHA-256 of its policy is .*, not the row's, {digest}"

        def digest_of_receipt():
            evaluation = copy.deepcopy(self.receipt.evaluation)
            evaluation["conditions"][CONDITION]["policy_sha256"] = digest
            self.write(evaluation)
            return f"the SHA-256 of its policy is {digest}"

        return self.choice(name_of_row, name_of_receipt, digest_of_row, digest_of_receipt)

    def another_row(self):
        """The receipt, or some of its episodes, are another row's, also with the policy's name and digest."""
        other = Receipt.read(self.board / OTHER / f"{PROTOCOL}.npz")

        def whole():
            shutil.copy(self.board / OTHER / f"{PROTOCOL}.npz", self.path)
            return f"its policy is '{OTHER}', not the row's"

        def some():
            count = int(self.generator.integers(1, 100))
            for place in self.generator.choice(len(self.results), count, replace=False):
                self.put(int(place), other.results[CONDITION][place], other.traces[CONDITION][place])
            self.write()
            return f"{count} of its episodes are those of the row {OTHER}"

        return self.choice(whole, some, some)

    def replaced_values(self):
        """Another setting of the environments, which the receipt names, or conceals."""
        evaluation = copy.deepcopy(self.receipt.evaluation)
        changes = [
            {"robot_noise_ratio": round(float(self.generator.uniform(0.0, 0.009)), 6)},
            {"object_noise_ratio": round(float(self.generator.uniform(0.001, 1.0)), 6)},
            {"control_mode": "joint_position"},
            {"variations": ["layout"]},
            {"physics": "fast"},
            {"reward": "dense"},
            {"success": "strict"},
        ]
        change = changes[int(self.generator.integers(len(changes)))]
        for condition in evaluation["conditions"].values():
            condition["task_kwargs"] = {**condition["task_kwargs"], **change}

        def named():
            self.write(evaluation)
            return f"it replaces the protocol's {next(iter(change))}"

        def concealed():
            self.write(evaluation)
            dataclasses.replace(Receipt.read(self.path), replaced=[]).write(self.path)
            return "are not the protocol's values, but the receipt names"

        return self.choice(named, named, concealed)

    def repeated_episodes(self):
        """Some episodes stand in the places of others as well."""
        count = int(self.generator.integers(1, 30))
        places = self.generator.choice(len(self.results), 2 * count, replace=False)
        for source, place in zip(places[:count], places[count:], strict=True):
            self.put(int(place), self.results[source], self.traces[source])
        self.write()
        return rf"episode \d+ of {CONDITION} repeats episode \d+"

    def edited_scores(self):
        """A score is another one; or a result, and all that follows from it."""

        def score():
            with np.load(self.path) as file:
                arrays = dict(file)
            metadata = json.loads(str(arrays["metadata"]))
            name = str(self.generator.choice(["success", "clean_success", "mean_tasks"]))
            for scores in (metadata["evaluation"], metadata["evaluation"]["conditions"][CONDITION]):
                scores[name] = round(float(self.generator.uniform(0.0, scores[name])), 6)
            arrays["metadata"] = np.array(json.dumps(metadata))
            self.path.write_bytes(sealed(files.pack_arrays(arrays)))
            return "the file was altered"

        def result():
            one = self.results[self.index]
            measures = {**one.measures, "clean_success": not one.measures["clean_success"]}
            success = {"success": True, "success_at_end": True, "steps_to_success": 1}
            self.results[self.index] = dataclasses.replace(one, measures=measures, **success)
            self.write()
            return f"the replay of episode {self.index} of {CONDITION} differs"

        return self.choice(score, result)

    def no_receipt(self):
        """The receipt of a row is not there, or the row does not name it."""

        def removed():
            self.path.unlink()
            return rf"{PROTOCOL}\.npz, which the row names, is not there"

        def moved():
            name = f"{self.generator.integers(10**6)}.npz"
            self.path.rename(self.path.with_name(name))
            return rf"{PROTOCOL}\.npz, which the row names, is not there"

        def promised():
            state(self.board, receipts={**stated(self.board)["receipts"], "unseen-kitchens": None})
            return r"unseen-kitchens\.npz, which the row names, is not there"

        def empty():
            self.path.write_bytes(self.generator.bytes(int(self.generator.integers(100))))
            return "does not hold a receipt"

        return self.choice(removed, moved, promised, empty)


KINDS = (
    "other_seeds",
    "chosen_episodes",
    "altered_actions",
    "another_protocol",
    "another_policy",
    "another_row",
    "replaced_values",
    "repeated_episodes",
    "edited_scores",
    "no_receipt",
)
FULL = range(4)
NIGHTLY = range(4, 20)


@pytest.mark.parametrize("number", [*FULL, *(pytest.param(number, marks=pytest.mark.nightly) for number in NIGHTLY)])
@pytest.mark.parametrize("kind", KINDS)
def test_a_forged_row_is_refused(make, board, spare, tmp_path, capsys, kind, number):
    reason = getattr(Forger(board, spare, number), kind)()
    assert_refused(make, board, tmp_path, capsys, reason)


@pytest.mark.nightly
def test_every_receipt_is_replayed_equal(make, tmp_path):
    folder = tmp_path / "board"
    shutil.copytree(BOARD, folder)
    assert make.main(["--all"], folder, tmp_path / "board.md") == 0
