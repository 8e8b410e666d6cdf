"""docs/scripts/curves.py draws the curves of training runs."""

import json

import numpy as np
import pytest
from docs_scripts import load_script

pytestmark = pytest.mark.clients


@pytest.fixture(scope="module")
def curves():
    return load_script("scripts/curves")


def write(folder, rows, tags=("time/minutes", "evaluation/success", "evaluation/progress"), domain="kitchen"):
    """Writes evaluations as training does, from rows of control steps, minutes, success and progress."""
    from torch.utils.tensorboard import SummaryWriter

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "training.json").write_text(json.dumps({"domain_name": domain}), "utf-8")
    with SummaryWriter(str(folder)) as writer:
        for step, *values in rows:
            for name, value in zip(tags, values, strict=False):
                writer.add_scalar(name, value, step)


def test_reading_a_run_returns_the_written_values(curves, tmp_path):
    write(tmp_path / "seed_0", [(0, 0, 0, 0), (500_000, 1.5, 0.25, 0.1), (1_000_000, 3, 1, 0.3)])
    for folder in (tmp_path, tmp_path / "seed_0"):
        curve = curves.read(folder)
        np.testing.assert_allclose(curve.steps, [0, 0.5, 1])
        np.testing.assert_allclose(curve.minutes, [0, 1.5, 3])
        np.testing.assert_allclose(curve.success, [0, 25, 100])
        np.testing.assert_allclose(curve.progress, [0, 0.1, 0.3], rtol=1e-6)


def test_every_evaluation_of_a_long_run_is_read(curves, tmp_path):
    write(tmp_path, [(i, i, 0, 0) for i in range(11_000)])
    assert len(curves.read(tmp_path).steps) == 11_000


def test_seeds_follow_one_another(curves, tmp_path):
    write(tmp_path / "seed_9", [(0, 1, 0, 0.01), (2_000_000, 5, 0, 0.02)])
    write(tmp_path / "seed_10", [(0, 1, 0, 0), (1_000_000, 3, 0.5, 0.2)])
    curve = curves.read(tmp_path)
    np.testing.assert_allclose(curve.steps, [0, 2, 2, 3])
    np.testing.assert_allclose(curve.minutes, [1, 5, 6, 8])
    np.testing.assert_allclose(curve.progress, [0.01, 0.02, 0, 0.2], rtol=1e-6)


def test_an_incompletely_written_evaluation_is_left_out(curves, tmp_path):
    write(tmp_path, [(0, 1, 0, 0), (10, 2, 0)])
    assert list(curves.read(tmp_path).steps) == [0]


def test_the_picture_has_a_line_in_each_panel_for_each_run(curves, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    drawn, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *rest, **options: (drawn.append(self), save(self, *rest)))
    runs = {}
    for index in range(9):
        write(tmp_path / str(index), [(0, 1, 0, 0), (1_000_000, 3, index / 9, 0.02 * index)])
        runs[f"run {index}"] = tmp_path / str(index)
    out = tmp_path / "curves.png"
    assert curves.main([str(out), *(f"{label}={folder}" for label, folder in runs.items())]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    (figure,) = drawn
    assert len(figure.axes) == 4
    for axis in figure.axes:
        styles = {(line.get_color(), line.get_linestyle()) for line in axis.lines}
        assert len(styles) == 9
        assert axis.get_xlabel()
        assert axis.get_ylabel()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == list(runs)


def test_runs_with_the_same_label_have_the_same_style(curves, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *rest, **options: drawn.append(self))
    for index in range(3):
        write(tmp_path / str(index), [(0, 1, 0, 0), (10, 3, index / 3, 0.0)])
    labels = ("kettle", "microwave", "kettle")
    runs = [f"{label}={tmp_path / str(index)}" for index, label in enumerate(labels)]
    assert curves.main([str(tmp_path / "curves.png"), *runs]) == 0
    (figure,) = drawn
    for axis in figure.axes:
        first, second, third = (line.get_color() for line in axis.lines)
        assert first == third != second
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["kettle", "microwave"]


@pytest.mark.parametrize("arguments", [[], ["out.png"], ["out.pdf", "a=b"], ["out.png", "folder"], ["out.png", "=b"]])
def test_bad_arguments_print_the_usage(curves, capsys, arguments):
    assert curves.main(arguments) == 2
    assert "docs/scripts/curves.py OUT.png LABEL=RUN_FOLDER" in capsys.readouterr().err


def test_a_folder_without_curves_is_named(curves, capsys, tmp_path):
    assert curves.main([str(tmp_path / "out.png"), f"run={tmp_path}"]) == 1
    assert capsys.readouterr().err == f"curves.py: {tmp_path} holds no curves of kitchen-train\n"


@pytest.mark.parametrize(
    ("domain", "label"), [("kitchen", "mean tasks completed"), ("open_cabinet", "mean opening [m]")]
)
def test_the_progress_is_labelled_by_domain(curves, tmp_path, domain, label):
    write(tmp_path / "run", [(0, 1, 0, 0)], domain=domain)
    assert curves.progress_label([tmp_path / "run"]) == label
    (tmp_path / "run" / "seed_0").mkdir()
    assert curves.progress_label([tmp_path / "run" / "seed_0"]) == label


def test_domains_with_different_progress_do_not_share_a_plot(curves, capsys, tmp_path):
    for domain in ("kitchen", "open_cabinet"):
        write(tmp_path / domain, [(0, 1, 0, 0)], domain=domain)
    runs = [f"{domain}={tmp_path / domain}" for domain in ("kitchen", "open_cabinet")]
    assert curves.main([str(tmp_path / "out.png"), *runs]) == 1
    assert "mean opening [m], mean tasks completed" in capsys.readouterr().err
