"""Certificates of generated kitchens: how they are made, their file, and episodes of what is certified."""

import os
import signal
import sys
import time

import msgspec
import numpy as np
import pytest
from docs_blocks import ROOT
from docs_scripts import load_script
from helpers.processes import open_process

from kitchen_suite import suite
from kitchen_suite.entities import KitchenDesign
from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.evaluation import certification
from kitchen_suite.evaluation.certification import check_certificates, write_certificates
from kitchen_suite.tasks.generated_kitchens import certificates

DESIGN = 0


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    """File of the certificate of one kitchen."""
    path = tmp_path_factory.mktemp("certificates") / "train.jsonl"
    assert list(write_certificates(path, [DESIGN], "train")) == [DESIGN]
    return path


@pytest.fixture
def ship(tmp_path, monkeypatch):
    """Puts certificates of `train` in place of those of the package; the user has none."""
    monkeypatch.setattr(certificates, "_SHIPPED", tmp_path)
    monkeypatch.setattr(certificates, "default_path", lambda split: None)

    def ship(*given):
        (tmp_path / "train.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in given))

    return ship


def certificate_of(number, **changes):
    """A certificate of a kitchen of the split `train`, made up."""
    digest = certificates.design_digest(KitchenDesign.drawn(number, "train"))
    given = {"design": number, "digest": digest, "physics": "fast", "depth_mm": 0.0, "reached": {}, "steps": {}}
    return certificates.Certificate(**{**given, **changes})


def line_of(certificate):
    return msgspec.json.encode(certificate) + b"\n"


@pytest.fixture
def made_up(monkeypatch):
    """Makes certificates up, in place of the expert's; the numbers of the kitchens in order."""
    made = []

    def certify(number, split):
        made.append(number)
        return certificate_of(number)

    monkeypatch.setattr(certification, "certify", certify)
    return made


@pytest.mark.full
def test_a_kitchen_is_certified_and_the_certificate_holds(certified):
    certificate = certificates.read(certified)[DESIGN]
    task = suite.load("kitchens", "any", {"design": DESIGN, "visuals": False}).task
    assert certificate.steps.keys() == {*task.requests.tasks}
    assert certificate.depth_mm <= 4.0
    assert len(certificate.reached) == len(task.scene.parts)
    assert check_certificates(certified, [DESIGN], "train") == []


@pytest.mark.full
def test_a_certificate_is_that_of_the_package(certified):
    assert certified.read_bytes() == (certificates._SHIPPED / "train.jsonl").read_bytes().splitlines(keepends=True)[0]


@pytest.mark.nightly
def test_several_processes_make_the_same_certificates(certified, tmp_path):
    path = tmp_path / "train.jsonl"
    write_certificates(path, [DESIGN], "train", num_workers=2)
    assert path.read_bytes() == certified.read_bytes()


@pytest.mark.full
def test_an_altered_certificate_does_not_hold(certified, tmp_path):
    found = certificates.read(certified)[DESIGN]
    altered = {**found.steps, next(iter(found.steps)): None}
    path = tmp_path / "altered.jsonl"
    path.write_bytes(line_of(msgspec.structs.replace(found, steps=altered)))
    assert check_certificates(path, [DESIGN, DESIGN + 1], "train") == [DESIGN, DESIGN + 1]


def test_certificates_that_are_there_are_kept_and_those_cut_off_are_made_again(made_up, tmp_path):
    path = tmp_path / "cut.jsonl"
    path.write_bytes(line_of(certificate_of(7, depth_mm=0.5)) + line_of(certificate_of(0))[:40])
    assert list(certificates.read(path)) == [7]
    assert list(write_certificates(path, range(2), "train")) == [0, 1]
    assert made_up == [0, 1]
    assert path.read_bytes() == b"".join(map(line_of, (certificate_of(7, depth_mm=0.5), *map(certificate_of, (0, 1)))))


def test_an_interrupt_leaves_whole_lines_and_the_same_call_continues(made_up, tmp_path, monkeypatch):
    path, certify = tmp_path / "train.jsonl", certification.certify

    def interrupted(number, split):
        if number == 2:
            raise KeyboardInterrupt
        return certify(number, split)

    with monkeypatch.context() as patch:
        patch.setattr(certification, "certify", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_certificates(path, range(4), "train")
    assert path.read_bytes() == b"".join(map(line_of, map(certificate_of, (0, 1))))
    assert list(write_certificates(path, range(4), "train")) == [0, 1, 2, 3]
    assert made_up == [0, 1, 2, 3]


def test_certificates_of_other_designs_are_not_completed(made_up, tmp_path):
    stale = certificate_of(0, digest="0" * 16)
    path = tmp_path / "stale.jsonl"
    path.write_bytes(line_of(stale))
    for certify in (write_certificates, check_certificates):
        with pytest.raises(ValueError, match="another design as kitchen train/0"):
            certify(path, range(2), "train")
    assert certificates.read(path) == {0: stale}


@pytest.mark.parametrize("text", ["no certificate\n", '{"rows": []}', '{"design":3}\n{"name": "mine"}'])
def test_a_file_that_holds_something_else_is_refused(made_up, text, tmp_path):
    path = tmp_path / "notes.jsonl"
    path.write_text(text)
    with pytest.raises(OSError, match=r"notes\.jsonl"):
        write_certificates(path, [0], "train")
    assert path.read_text() == text


def test_an_unknown_split_is_refused(made_up, tmp_path):
    with pytest.raises(ValueError, match=r"'tets'.*'test'"):
        write_certificates(tmp_path / "a.jsonl", [0], "tets")


def test_the_script_prints_a_table_and_checks(made_up, tmp_path, monkeypatch, capsys):
    script, path = load_script("experiments/certify"), tmp_path / "train.jsonl"
    steps = {"open drawers_1/drawer_1": 30, "open drawers_1/drawer_2": None, "turn_on hood_1/light_switch": 20}
    path.write_bytes(line_of(certificate_of(0, steps=steps, reached={"kettle/handle": True})))

    def run(*flags):
        monkeypatch.setattr("sys.argv", ["certify.py", f"--output={path}", "--num_workers=1", *flags])
        return script.main(), capsys.readouterr().out

    status, out = run("--designs=0:2")
    assert (status, made_up) == (0, [1])
    rows = [line.split() for line in out.splitlines()]
    assert ["open", "drawers", "2", "50%"] in rows
    assert ["all", "3", "66.7%"] in rows
    assert "2 kitchens; handles in reach: 100.0%; greatest depth: 0.0 mm" in out
    status, out = run("--designs=0:3", "--check")
    assert status == 1
    assert "1 of 3 certificates hold" in out
    assert out.count("has another certificate now, or none in the file") == 2


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
    with pytest.raises(ValueError, match=r"train/3 has no certificate.*write_certificates\("):
        suite.load("kitchens", "open", {"design": 3, "certified": True})
    own = KitchenDesign.make(3, "train").to_json()
    with pytest.raises(ValueError, match="only kitchens of a split have certificates"):
        suite.load("kitchens", "open", {"design": own, "certified": True})
    stale = certificates.Certificate(design=3, digest="0" * 16, physics="fast", depth_mm=0.0, reached={}, steps={})
    ship(stale)
    with pytest.raises(ValueError, match=r"train.jsonl .* another design as kitchen train/3"):
        suite.load("kitchens", "open", {"design": 3, "certified": True})


@pytest.mark.parametrize("split", SPLITS)
def test_the_certificates_of_the_package_are_of_todays_designs(split):
    found = certificates.read(certificates._SHIPPED / f"{split}.jsonl")
    assert list(found) == list(range(len(found)))
    assert len(found) >= 100
    for number, certificate in found.items():
        assert certificate.digest == certificates.design_digest(KitchenDesign.drawn(number, split)), number
        assert certificate.depth_mm <= 4.0
    pairs = np.concatenate([[steps is not None for steps in each.steps.values()] for each in found.values()])
    assert pairs.mean() >= 0.85


def test_a_designs_digest_does_not_depend_on_its_name():
    design = KitchenDesign.drawn(5, "test")
    named = msgspec.structs.replace(design, name="another")
    assert certificates.design_digest(named) == certificates.design_digest(design)


@pytest.mark.nightly
def test_an_interrupt_of_several_processes_keeps_what_is_finished_and_ends_them(tmp_path):
    """Of a signal to the program alone, as a batch system sends it."""
    program = tmp_path / "program.py"
    program.write_text(
        "import multiprocessing\n"
        "from kitchen_suite.evaluation.certification import write_certificates\n"
        "if __name__ == '__main__':\n"
        "    try:\n"
        "        write_certificates('mine.jsonl', range(40), 'train', num_workers=2)\n"
        "    except KeyboardInterrupt:\n"
        "        print(len(multiprocessing.active_children()), flush=True)\n",
        encoding="utf-8",
    )
    path = tmp_path / "mine.jsonl"
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    with open_process([sys.executable, program.name], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths}) as process:
        while not (path.exists() and certificates.read(path)):
            assert process.poll() is None
            time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (0, "0\n"), err
    assert "Traceback" not in err
    finished = certificates.read(path)
    assert 1 <= len(finished) < 40
    assert path.read_bytes().endswith(b"\n")
