"""The pictures of the pages: the film at their head, and pictures of tasks in which one sees what happens."""

import re

import pytest
from docs_blocks import ROOT
from docs_scripts import load_script
from PIL import Image

from kitchen_suite.entities.fixture_designs import KINDS
from kitchen_suite.entities.kitchen_designs import KitchenDesign

PICTURES = ROOT / "docs" / "pictures"
FILM = PICTURES / "film.webp"
MEGABYTE = 1_000_000


def pictures_of(page):
    """Returns the files of a page's pictures, in order."""
    names = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    return [(page.parent / name).resolve() for name in names]


def test_the_film_moves_and_is_small():
    assert FILM.stat().st_size <= 2 * MEGABYTE
    with Image.open(FILM) as film:
        assert film.is_animated
        # A drawer is opened, and a can is put into it: half a minute at four times the speed, 25 frames per second.
        assert film.n_frames > 150
        assert film.width >= 640
        assert film.info["loop"] == 0


def test_pictures_of_tasks_are_large_but_not_their_files():
    tasks = set(pictures_of(ROOT / "docs" / "domains" / "gallery.md")) - {FILM}
    assert len(tasks) >= 25
    for path in tasks:
        with Image.open(path) as picture:
            assert picture.width >= 960, path
        assert path.stat().st_size <= 300_000, path


def test_all_pictures_are_shown_and_together_small():
    shown = {path for page in (ROOT / "docs").rglob("*.md") for path in pictures_of(page)}
    files = set(PICTURES.iterdir()) - {PICTURES / "experts.mp4"}
    assert {path.name for path in files - shown} == set()
    assert sum(path.stat().st_size for path in files) <= 10 * MEGABYTE


def test_the_diagram_of_the_grammar_has_every_kind_of_fixture():
    text = (PICTURES / "kitchens_grammar.svg").read_text(encoding="utf-8")
    assert [kind for kind in KINDS if kind not in text] == []


@pytest.mark.full
def test_the_diagram_says_what_may_stand_beside_the_robot():
    found = {"oven": set(), "cabinets": set()}
    for placed in (KitchenDesign.drawn(number, "train").placed for number in range(500)):
        kinds = {each.design.kind for each in placed}
        found["oven" if "oven" in kinds else "cabinets"] |= {each.design.kind for each in placed if each.yaw != 0.0}
    assert found == {wall: {*kinds} for wall, kinds in load_script("scripts/pictures").BESIDE.items()}
