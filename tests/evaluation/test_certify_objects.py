"""Certificates of the tasks with objects: how they are made, and those of the package."""

import msgspec
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.domains.pick_and_place import PICK_AND_PLACE
from kitchen_suite.entities import KitchenDesign, ObjectLayout
from kitchen_suite.evaluation import object_certification
from kitchen_suite.evaluation.certification import write_certificates
from kitchen_suite.evaluation.object_certification import OBJECTS
from kitchen_suite.tasks.generated_kitchens.certificates import design_digest, read
from kitchen_suite.tasks.pick_and_place import certificates
from kitchen_suite.tasks.pick_and_place.certificates import ObjectCertificate, layout_digest
from kitchen_suite.tasks.pick_and_place.requests import VERBS

SHIPPED = sorted(certificates._SHIPPED.glob("*.jsonl"))


def certificate_of(number, steps, **changes):
    """A certificate of a kitchen of the split `train`, made up."""
    design = KitchenDesign.drawn(number, "train")
    given = {
        "design": number,
        "digest": design_digest(design),
        "layout": layout_digest(ObjectLayout.drawn(design)),
        "physics": "fast",
        "steps": steps,
    }
    return ObjectCertificate(**{**given, **changes})


@pytest.fixture
def ship(tmp_path, monkeypatch):
    """Puts certificates of `train` in place of those of the package; the user has none."""
    monkeypatch.setattr(certificates, "_SHIPPED", tmp_path)
    monkeypatch.setattr(certificates, "default_path", lambda split: None)

    def ship(*given):
        (tmp_path / "train.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in given))

    return ship


def load(**arguments):
    return suite.load("pick_and_place", "any", {"visuals": False, **arguments})


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_certificates_of_the_package_are_of_their_designs_and_layouts(path):
    found = read(path, ObjectCertificate)
    assert list(found) == sorted(found)
    for number, certificate in found.items():
        design = KitchenDesign.drawn(number, path.stem)
        assert certificate.digest == design_digest(design), number
        assert certificate.layout == layout_digest(ObjectLayout.drawn(design)), number
        assert certificate.physics == PICK_AND_PLACE.physics


def test_every_kitchen_of_the_protocol_has_a_certified_task():
    found = read(certificates._SHIPPED / "test.jsonl", ObjectCertificate)
    assert {*range(100)} <= {number for number, certificate in found.items() if certificate.certified}


def test_environments_ask_for_certified_tasks_alone(ship):
    tasks = load(design=5).task.requests.tasks
    chosen = tasks[0], tasks[-1]
    ship(certificate_of(5, {chosen[0]: 100, tasks[1]: None, chosen[1]: 200}))
    task = load(design=5, certified=True).task
    assert {*task.requests.tasks} == {*chosen}


def test_certificates_of_other_objects_are_refused(ship):
    ship(certificate_of(5, {}, layout="0" * 16))
    with pytest.raises(ValueError, match="of other objects: leave out objects or certified"):
        load(design=5, certified=True)


def test_a_kitchen_without_a_certificate_names_the_call_that_makes_one(ship, tmp_path, monkeypatch):
    ship()
    with pytest.raises(ValueError, match=r"kind=kitchen_suite\.evaluation\.object_certification\.OBJECTS") as caught:
        load(design=5, certified=True)
    # Which is followed.
    assert "write_certificates(certificates.default_path('train'), [5], 'train'" in str(caught.value)
    own = tmp_path / "own.jsonl"
    monkeypatch.setattr(certificates, "default_path", lambda split: own)
    tasks = load(design=5).task.requests.tasks
    made = OBJECTS._replace(certify=lambda number, split: certificate_of(number, {tasks[0]: 50}))
    write_certificates(certificates.default_path("train"), [5], "train", kind=made)
    environment = load(design=5, certified=True)
    assert environment.task.requests.tasks == (tasks[0],)
    # Another machine does not have this file: specifications have the tasks by name.
    contents = PICK_AND_PLACE.with_contents({"design": 5, "certified": True})
    assert contents["certified"] == [tasks[0]]


def test_a_task_is_certified_if_it_is_completed_in_both_episodes(monkeypatch):
    played = []

    def play(environment, act, name, seed):
        played.append((name, seed))
        verb = name.split(" ")[0]
        # Taken out in the first episode alone.
        return {"put_on": 100 + seed, "put_in": None, "take_out": None if seed else 90}.get(verb, 70)

    monkeypatch.setattr(object_certification, "played", play)
    certificate = object_certification.certify_objects(1, "test")
    by_verb = {
        verb: [steps for name, steps in certificate.steps.items() if name.startswith(f"{verb} ")] for verb in VERBS
    }
    assert by_verb["put_on"] == [101, 101]
    assert by_verb["put_in"] == [None] * len(by_verb["put_in"])
    assert by_verb["take_out"] == [None] * len(by_verb["take_out"])
    assert len(by_verb["put_in"]) <= 4
    assert {seed for name, seed in played if name.startswith("put_in ")} == {0}


@pytest.mark.full
def test_a_certified_task_is_completed_by_the_expert():
    found = read(certificates._SHIPPED / "test.jsonl", ObjectCertificate)
    environment = load(design=1, split="test", certified=True, random=0)
    name = found[1].certified[0]
    act = object_certification.policies.find("expert")(environment, np.random.default_rng(0))
    # On another kind of processor the same seed may fail.
    assert any(object_certification.played(environment, act, name, seed) for seed in range(4))
