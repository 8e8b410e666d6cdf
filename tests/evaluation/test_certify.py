"""Certificates of generated kitchens: `kitchen-certify`, its file, and episodes of what is certified."""

import msgspec
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.commands.commands import certify
from kitchen_suite.entities import KitchenDesign
from kitchen_suite.entities.designs import SPLITS
from kitchen_suite.tasks.generated_kitchens import certificates
from kitchen_suite.tasks.variations.layouts import CLEARANCE_TOLERANCE

DESIGN = 0


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    """File of the certificate of one kitchen."""
    path = tmp_path_factory.mktemp("certificates") / "train.jsonl"
    assert certify.main([f"--output={path}", f"--designs={DESIGN}:{DESIGN + 1}", "--num_workers=1"]) == 0
    return path


@pytest.fixture
def ship(tmp_path, monkeypatch):
    """Puts certificates of `train` in place of those of the package; the user has none."""
    monkeypatch.setattr(certificates, "_SHIPPED", tmp_path)
    monkeypatch.setattr(certificates, "default_path", lambda split: None)

    def ship(*given):
        (tmp_path / "train.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in given))

    return ship


@pytest.mark.thorough
def test_a_kitchen_is_certified_and_the_certificate_holds(certified, capsys):
    certificate = certificates.read(certified)[DESIGN]
    task = suite.load("kitchens", "any", {"design": DESIGN, "visuals": False}).task
    assert certificate.steps.keys() == {*task.requests.tasks}
    assert certificate.depth_mm <= 1e3 * CLEARANCE_TOLERANCE
    assert len(certificate.reached) == len(task.scene.parts)
    flags = [f"--output={certified}", f"--designs={DESIGN}:{DESIGN + 1}", "--num_workers=1"]
    assert certify.main([*flags, "--check"]) == 0
    assert "1 of 1 certificates hold" in capsys.readouterr().out


@pytest.mark.thorough
def test_what_is_there_is_kept_and_what_was_cut_off_is_certified_again(certified, tmp_path):
    line = certified.read_bytes()
    path = tmp_path / "cut.jsonl"
    path.write_bytes(line.replace(b'"design":0', b'"design":7') + line[:40])
    assert list(certificates.read(path)) == [7]
    assert certify.main([f"--output={path}", f"--designs={DESIGN}:{DESIGN + 1}", "--num_workers=1"]) == 0
    assert path.read_bytes() == line.replace(b'"design":0', b'"design":7') + line


@pytest.mark.thorough
def test_an_altered_certificate_does_not_hold(certified, tmp_path, capsys):
    found = certificates.read(certified)[DESIGN]
    altered = {**found.steps, next(iter(found.steps)): None}
    path = tmp_path / "altered.jsonl"
    path.write_bytes(msgspec.json.encode(msgspec.structs.replace(found, steps=altered)) + b"\n")
    flags = [f"--output={path}", f"--designs={DESIGN}:{DESIGN + 2}", "--num_workers=1", "--check"]
    assert certify.main(flags) == 1
    out = capsys.readouterr().out
    assert f"kitchen train/{DESIGN} has another certificate now" in out
    assert f"kitchen train/{DESIGN + 1} has no certificate in the file" in out
    assert "0 of 2 certificates hold" in out


def test_certificates_of_other_designs_are_not_completed(tmp_path, capsys):
    stale = certificates.Certificate(design=0, digest="0" * 16, physics="fast", depth_mm=0.0, reached={}, steps={})
    path = tmp_path / "stale.jsonl"
    path.write_bytes(msgspec.json.encode(stale) + b"\n")
    assert certify.main([f"--output={path}", "--designs=0:2", "--num_workers=1"]) in (1, 2)
    assert f"{path} has a certificate of another design as kitchen train/0" in capsys.readouterr().err
    assert certificates.read(path) == {0: stale}


@pytest.mark.parametrize("designs", ["3", "5:5", "7:2", "a:b", "-1:3", "0:1:2"])
def test_numbers_of_kitchens_that_are_no_range_are_refused(designs, tmp_path, capsys):
    assert certify.main([f"--output={tmp_path / 'a.jsonl'}", f"--designs={designs}"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("text", ["no certificate\n", '{"rows": []}', '{"design":3}\n{"name": "mine"}'])
def test_a_file_that_holds_something_else_is_refused(text, tmp_path, capsys):
    path = tmp_path / "notes.jsonl"
    path.write_text(text)
    assert certify.main([f"--output={path}", "--designs=0:1"]) in (1, 2)
    assert capsys.readouterr().err.count("\n") == 1
    assert path.read_text() == text


def test_episodes_of_certified_kitchens_ask_for_certified_tasks_alone(ship):
    design = KitchenDesign.make(DESIGN, "train")
    everything = suite.load("kitchens", "any", {"design": DESIGN, "visuals": False}).task.requests.tasks
    kept = everything[::3]
    certificate = certificates.Certificate(
        design=DESIGN,
        digest=certificates.design_digest(design),
        physics="fast",
        depth_mm=0.0,
        reached={},
        steps={task: 10 if task in kept else None for task in everything},
    )
    ship(certificate)
    environment = suite.load("kitchens", "any", {"design": DESIGN, "certified": True, "visuals": False, "random": 0})
    asked = set()
    for _ in range(60):
        environment.reset()
        asked.update(environment.task.requested_tasks)
    assert asked == {*kept}


def test_kitchens_without_a_certificate_of_theirs_are_refused(ship):
    ship()
    with pytest.raises(ValueError, match=r"train/3 has no certificate: kitchen-certify --split=train --designs=3:4"):
        suite.load("kitchens", "open", {"design": 3, "certified": True})
    own = KitchenDesign.make(3, "train").to_json()
    with pytest.raises(ValueError, match="only kitchens of a split have certificates"):
        suite.load("kitchens", "open", {"design": own, "certified": True})
    stale = certificates.Certificate(design=3, digest="0" * 16, physics="fast", depth_mm=0.0, reached={}, steps={})
    ship(stale)
    with pytest.raises(ValueError, match=r"train.jsonl has a certificate of another design as kitchen train/3: remove"):
        suite.load("kitchens", "open", {"design": 3, "certified": True})


@pytest.mark.parametrize("split", SPLITS)
def test_the_certificates_of_the_package_are_of_todays_designs(split):
    found = certificates.read(certificates._SHIPPED / f"{split}.jsonl")
    assert list(found) == list(range(len(found)))
    assert len(found) >= 100
    for number, certificate in found.items():
        assert certificate.digest == certificates.design_digest(KitchenDesign.drawn(number, split)), number
        assert certificate.depth_mm <= 1e3 * CLEARANCE_TOLERANCE
    pairs = np.concatenate([[steps is not None for steps in each.steps.values()] for each in found.values()])
    assert pairs.mean() >= 0.85


def test_a_designs_digest_does_not_depend_on_its_name():
    design = KitchenDesign.drawn(5, "test")
    named = msgspec.structs.replace(design, name="another")
    assert certificates.design_digest(named) == certificates.design_digest(design)
