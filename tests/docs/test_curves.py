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
