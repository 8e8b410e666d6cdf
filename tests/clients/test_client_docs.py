"""The snippets for clients run as they stand."""

import re
import warnings
from pathlib import Path

import pytest

pytestmark = pytest.mark.clients

PAGE = Path(__file__).resolve().parents[2] / "docs" / "clients.md"
VECTORISED = "Vectorised environments of Stable-Baselines3"
TITLES = ["Gymnasium", "Stable-Baselines3", VECTORISED, "TorchRL", "Shimmy", "Minari", "skrl"]
# Those with `python` in place of `py` need no client and are run with all other pages' examples.
SNIPPETS = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_every_client_has_a_snippet():
    page = PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", page, re.MULTILINE) == [title for title in TITLES if title != VECTORISED]
    assert len(SNIPPETS) == len(TITLES)


@pytest.mark.parametrize(
    "snippet",
    [pytest.param(snippet, marks=pytest.mark.rendering if "RecordVideo" in snippet else ()) for snippet in SNIPPETS],
    ids=TITLES,
)
def test_the_snippet_runs(snippet, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    names = {}
    with warnings.catch_warnings():
        # Minari would like to be told more about the dataset.
        warnings.filterwarnings("ignore", r"`\w+` is set to None")
        exec(compile(snippet, "snippet", "exec"), names)
    # The files that stepping needs are still there.
    assert names["environment"].action_space.shape == (9,)
    names["environment"].close()
