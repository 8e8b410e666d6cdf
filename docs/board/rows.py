"""Rows of the board: what they state, and whether their receipts prove it.

A row is a folder with `row.json`, which has the fields of `Statement`, and with a receipt `PROTOCOL.npz` for each
protocol that it names. `read_rows` checks all that can be checked without a simulation, and `replay` plays a receipt
again.
"""

import dataclasses
import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from kitchen_suite import Evaluation, checks, files
from kitchen_suite.evaluation.check import ReplayedResult
from kitchen_suite.gymnasium_env.observations import OF_OBSERVATIONS
from kitchen_suite.versions import machine


@dataclasses.dataclass(frozen=True, kw_only=True)
class Board:
    """A table of the board.

    Attributes:
      domain_name: of its protocol's episodes.
      score: by which rows are in order; a rate.
      text: what its episodes ask for.
    """

    domain_name: str
    score: str
    text: str


BOARDS: Mapping[str, Board] = MappingProxyType(
    {
        "unseen-kitchens": Board(
            domain_name="kitchens",
            score="success",
            text="One part to open, in each of 100 generated kitchens that no policy has seen, in fast physics.",
        ),
        "unseen-pick-and-place": Board(
            domain_name="pick_and_place",
            score="success",
            text="One object to put away, in each of 100 generated kitchens that no policy has seen, in fast physics.",
        ),
        "clean": Board(
            domain_name="kitchen",
            score="clean_success",
            text="Four of seven tasks in the kitchen, drawn for each episode, from varied starts.",
        ),
    }
)
"""The tables of the board by protocol, in the order of the page."""

MAX_RECEIPT = 6 * 2**20
"""Greatest receipt [bytes]. Random actions, which cannot be compressed, take 5.3 MiB under `unseen-pick-and-place`."""

STATEMENT = "row.json"

# Headings, links and fenced lines, which no markup of a row's own may end.
_Title = Annotated[str, Meta(max_length=60, pattern=r"^[\w ,.+()-]+\Z")]
_Link = Annotated[str, Meta(max_length=200, pattern=r"^(https://|\.\./)[\w./~%#?=&-]+\Z")]
_Command = Annotated[str, Meta(max_length=600, pattern=r"^[ -_a-~]+\Z")]
# Any text of one line.
_Text = Annotated[str, Meta(max_length=400, pattern=r"^[^\n\r]+\Z")]
_Digest = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]


class Statement(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The statements of a row: the contents of `row.json`.

    Attributes:
      title: of the row.
      policy: name of the policy, as its receipts have it.
      link: to a paper or to code: an https address, or a path from the folder `docs/results`.
      training: how the policy was trained, in a sentence.
      cost: of the training.
      observes: what the policy observes.
      commands: that train and evaluate it.
      receipts: by protocol, the SHA-256 of the policy's file, as the receipt has it; null for a policy without a file.
    """

    title: _Title
    policy: _Text
    link: _Link
    training: _Text
    cost: _Text
    observes: list[Literal["states", "images", "language"]]
    commands: Annotated[list[_Command], Meta(min_length=1)]
    receipts: Annotated[dict[str, _Digest | None], Meta(min_length=1)]


class RefusedError(Exception):
    """A row does not hold; the message names the row and the reason."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Receipt:
    """A receipt of a row.

    Attributes:
      row: name of the row's folder.
      protocol: name of the protocol.
      sha256: of the file.
      evaluation: its contents, which agree with each other.
    """

    row: str
    protocol: str
    sha256: str
    evaluation: Evaluation

    @property
    def name(self) -> str:
        """Path of the file in the folder of the board."""
        return f"{self.row}/{self.protocol}.npz"


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """A row: the name of its folder, its statement, and its receipts by protocol."""

    name: str
    statement: Statement
    receipts: Mapping[str, Receipt]


def read_rows(folder: Path, known: Collection[str] = ()) -> list[Row]:
    """Returns the rows in a folder, in the order of their names.

    Args:
      folder: of the board.
      known: SHA-256 of receipts whose replay was equal. Of two rows with the same episodes, it is the other's copy.

    Raises:
      RefusedError: a row does not agree with itself, with its protocols or with another row.
    """
    rows = [read_row(each) for each in sorted(folder.iterdir()) if each.is_dir() and each.name != "__pycache__"]
    titles: dict[str, str] = {}
    for row in rows:
        if row.statement.title in titles:
            raise RefusedError(f"{row.name}: the row {titles[row.statement.title]} has the same title")
        titles[row.statement.title] = row.name
    for protocol in BOARDS:
        receipts = [row.receipts[protocol] for row in rows if protocol in row.receipts]
        _refuse_copies(sorted(receipts, key=lambda receipt: receipt.sha256 not in known))
    return rows


def read_row(folder: Path) -> Row:
    """Returns the row in a folder; raises a RefusedError unless its receipts are of its policy and their protocols."""
    try:
        record = files.load_json(folder / STATEMENT, "a row of the board")
        statement = files.parse(record, Statement, "not a row")
    except (OSError, ValueError) as error:
        raise RefusedError(f"{folder.name}: {error}") from error
    present = {path.name for path in folder.iterdir()}
    expected = {STATEMENT, *(f"{protocol}.npz" for protocol in statement.receipts)}
    if missing := sorted(expected - present):
        raise RefusedError(f"{folder.name}: {missing[0]}, which the row names, is not there")
    if further := sorted(present - expected):
        raise RefusedError(f"{folder.name}: {further[0]} is there, which the row does not name")
    receipts = {protocol: _read_receipt(folder, statement, protocol) for protocol in statement.receipts}
    return Row(name=folder.name, statement=statement, receipts=receipts)


def _read_receipt(folder: Path, statement: Statement, protocol: str) -> Receipt:
    """Returns a receipt of a row; raises a RefusedError unless it is of the row's policy and of the protocol."""
    path = folder / f"{protocol}.npz"
    try:
        checks.choice(protocol, BOARDS, "protocol of the board")
        files.check_size(path.stat().st_size, MAX_RECEIPT)
        evaluation = Evaluation.read(path)
    except (OSError, ValueError) as error:
        raise RefusedError(f"{folder.name}: {path.name}: {error}") from error
    problem = next(_problems(evaluation, statement, protocol), None)
    if problem is not None:
        raise RefusedError(f"{folder.name}: {path.name}: {problem}")
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Receipt(row=folder.name, protocol=protocol, sha256=sha256, evaluation=evaluation)


def _problems(evaluation: Evaluation, statement: Statement, protocol: str) -> Iterator[str]:
    """Yields why a receipt that agrees with itself is not what its row states."""
    plan = evaluation.plan
    board = BOARDS[protocol]
    found = plan.description
    if (plan.protocol, plan.first.domain_name) != (protocol, board.domain_name):
        yield f"it is of protocol {plan.protocol} in the domain {plan.first.domain_name}"
    # A policy may observe what it needs: nothing else of an episode depends on it.
    replaced = {name: pair for name, pair in plan.changes.items() if name.rpartition(": ")[2] not in OF_OBSERVATIONS}
    for name, (value, own) in replaced.items():
        yield f"it replaces the protocol's {name}, {checks.shown(own)}, by {checks.shown(value)}"
    if found["policy"] != statement.policy:
        yield f"its policy is {checks.shown(found['policy'])}, not the row's, {checks.shown(statement.policy)}"
    stated = statement.receipts[protocol]
    for name, condition in found["conditions"].items():
        if condition["policy_sha256"] != stated:
            digest = condition["policy_sha256"]
            yield f"the SHA-256 of its policy is {digest} in the condition {name!r}, not the row's, {stated}"
    episodes: dict[bytes, str] = {}
    for name, episode, digest in _episodes(evaluation):
        if digest in episodes:
            yield f"{episode} of {name} repeats {episodes[digest]}"
        episodes[digest] = f"{episode} of {name}"


def _episodes(evaluation: Evaluation) -> Iterator[tuple[str, str, bytes]]:
    """Yields condition, name and digest of each episode; noise and start make the digests of seeds differ."""
    for name, traces in evaluation.traces.items():
        for number, trace in enumerate(traces):
            yield name, f"episode {number}", trace.digest.tobytes()


def _refuse_copies(receipts: Sequence[Receipt]) -> None:
    """Raises a RefusedError if a receipt has an episode of an earlier one, with the same numbers to the bit."""
    owners: dict[bytes, str] = {}
    for receipt in receipts:
        digests = {digest for _, _, digest in _episodes(receipt.evaluation)}
        if common := sorted(digests & owners.keys()):
            owner = owners[common[0]]
            count = f"{len(common)} of its episodes are those of the row {owner}, to the bit"
            raise RefusedError(f"{receipt.row}: {receipt.protocol}.npz: {count}")
        owners |= dict.fromkeys(digests, receipt.row)


def replay(receipt: Receipt, known: Collection[str] = ()) -> None:
    """Plays the episodes of a receipt again; raises a RefusedError for the first that differs.

    All numbers have to be equal to the bit. If a receipt is known, since it was equal on the kind of processor that
    wrote it, it is enough on another kind that all results are equal.

    Args:
      receipt: to be replayed.
      known: SHA-256 of receipts whose replay was equal.
    """
    written = receipt.evaluation.machine
    is_elsewhere = written != machine()
    accepted = {"equal", "other digits"} if is_elsewhere and receipt.sha256 in known else {"equal"}
    where = f"; it was written on another kind of processor, {written}: replay it there" if is_elsewhere else ""

    def progress(episode: ReplayedResult) -> None:
        if episode.verdict not in accepted:
            what = f"the replay of episode {episode.episode} of {episode.condition} differs"
            reason = f"{what}: {'; '.join(episode.differences)}{where}"
            raise RefusedError(f"{receipt.row}: {receipt.protocol}.npz: {reason}")

    try:
        receipt.evaluation.check(progress=progress)
    except ValueError as error:
        raise RefusedError(f"{receipt.row}: {receipt.protocol}.npz: {error}") from error
