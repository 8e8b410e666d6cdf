"""`kitchen-doctor`: a fact a line, and digests that are compared where they are known."""

import pytest

from kitchen_suite import doctor, suite
from kitchen_suite.commands import find
from kitchen_suite.rendering import gl


@pytest.fixture(scope="module")
def found():
    """The digests of this machine."""
    return dict(doctor.digests())


@pytest.fixture
def quick(monkeypatch, found):
    """The command does not play the episodes again."""
    monkeypatch.setattr(doctor, "digests", lambda: found.items())


@pytest.fixture
def run(run):
    """Runs the command; returns status and stdout."""

    def run_doctor():
        status, out, err = run(find("doctor"))
        assert err == ""
        return status, out

    return run_doctor


def known_here(monkeypatch, found):
    monkeypatch.setattr(doctor, "expected", lambda here: found)


@pytest.mark.full
def test_facts_are_told_a_line_each(run, quick, monkeypatch):
    monkeypatch.setattr(gl, "find_library", lambda: "egl")
    monkeypatch.setattr(gl, "triton_libraries", lambda: ())
    status, out = run()
    lines = out.splitlines()
    assert status in (0, 1)
    assert lines[0].startswith("kitchen-suite ")
    for name in ("python", "processor", "mujoco", "GL", "extra train", "digest kitchen exact", "digest kitchen fast"):
        assert sum(line.startswith(f"{name} ") for line in lines) == 1
    assert "egl renders" in out
    assert "triton is not installed" in out
    assert {line.split()[1] for line in lines if line.startswith("digest")} == {*suite.DOMAINS}


@pytest.mark.full
@pytest.mark.parametrize(("signal", "words"), [(0, "no clash"), (11, "signal 11 ends a program that opens GL before")])
def test_a_clash_of_gl_and_triton_is_named(run, quick, monkeypatch, signal, words):
    monkeypatch.setattr(gl, "find_library", lambda: "egl")
    monkeypatch.setattr(gl, "triton_libraries", lambda: ("libtriton.so",))
    monkeypatch.setattr(gl, "signal_beside_triton", lambda library: signal)
    _, out = run()
    assert words in out


@pytest.mark.full
def test_digests_are_compared_where_they_are_known(run, found, monkeypatch):
    assert found == dict(doctor.digests())
    assert len({*found.values()}) == len(found)
    known_here(monkeypatch, {})
    status, out = run()
    assert (status, out.count("not known for these versions")) == (0, len(found))
    known_here(monkeypatch, found)
    status, out = run()
    assert (status, out.count("as known for this kind of processor")) == (0, len(found))
    known_here(monkeypatch, {**found, "kitchen fast": "0" * 64})
    status, out = run()
    assert (status, out.count("DIFFERS")) == (1, 1)


def test_digests_agree_where_this_kind_is_known(found):
    assert doctor.expected(doctor.circumstances()) in ({}, found)


def test_the_file_of_known_digests_has_every_domain():
    for record in doctor.files.load_json(doctor.KNOWN, "the known digests"):
        assert record["circumstances"].keys() == doctor.circumstances().keys()
        assert {name.partition(" ")[0] for name in record["digests"]} == {*suite.DOMAINS}


def test_a_missing_library_is_a_fact(run, quick, monkeypatch):
    def missing():
        raise OSError("no library was found")

    monkeypatch.setattr(gl, "find_library", missing)
    known_here(monkeypatch, {})
    status, out = run()
    assert status == 0
    assert "nothing can be rendered: OSError no library was found" in out


@pytest.mark.full
def test_what_fails_is_a_fact(run, monkeypatch, tmp_path):
    def fails(domain, physics):
        raise ValueError("a kitchen\nburns")

    monkeypatch.setattr(doctor, "_digest", fails)
    monkeypatch.setattr(doctor, "_SIMULATING", ("dm-control", "nothing-of-the-kind"))
    for contents in (None, "[", "[{}]", "3"):
        known = tmp_path / "known.json"
        monkeypatch.setattr(doctor, "KNOWN", known)
        if contents:
            known.write_text(contents)
        status, out = run()
        assert status == 0
        assert "digests                      no episode can be played: ValueError a kitchen burns\n" in out
    assert doctor.circumstances()["nothing-of-the-kind"] == "not installed"
