"""Objects in generated kitchens: layouts that a number draws, those in JSON and their errors, and the scenes."""

import copy
import json

import numpy as np
import pytest
from helpers.errors import ODD_VALUES, assert_is_short, refused
from helpers.object_kitchen import DESIGN, LAYOUT

from kitchen_suite.entities import KitchenDesign, ObjectLayout, build_generated_kitchen, build_pick_and_place
from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.entities.object_layouts import MAX_OBJECTS, MAX_PLACES, places_of
from kitchen_suite.entities.objects import OBJECTS
from kitchen_suite.entities.pick_and_place import DEFAULT_DESIGN
from kitchen_suite.entities.places import SURFACES
from kitchen_suite.tasks import PickAndPlaceTask
from kitchen_suite.tasks.generated_kitchens.certificates import certificate_of, design_digest
from kitchen_suite.tasks.pick_and_place.requests import VERBS, tasks_of

MINE = KitchenDesign.make(DESIGN, "train")


def drawn(count):
    """The first designs of each split with their layouts."""
    designs = [KitchenDesign.make(number, split) for split in SPLITS for number in range(count)]
    return [(design, ObjectLayout.make(None, design)) for design in designs]


def test_a_number_draws_the_same_layout_each_time_and_another_number_another():
    found = drawn(4)
    assert [layout for _, layout in drawn(4)] == [layout for _, layout in found]
    assert len({layout for _, layout in found}) == len(found)


@pytest.mark.full
@pytest.mark.parametrize("split", SPLITS)
def test_a_drawn_layout_is_within_its_bounds(split):
    kinds, counts, places = set(), set(), set()
    for number in range(100):
        design = KitchenDesign.make(number, split)
        layout = ObjectLayout.make(None, design)
        assert ObjectLayout.make(layout.to_json(), design) == layout
        assert 2 <= len(layout.objects) <= MAX_OBJECTS
        assert 1 <= len(layout.places) <= MAX_PLACES
        assert len(set(layout.names)) == len(layout.names)
        known = places_of(design)
        tops = [place for place in known.values() if place.kind == "worktop"]
        for thing in layout.objects:
            x, y, z = thing.position
            assert any(
                low_x <= x <= high_x and low_y <= y <= high_y and z == pytest.approx(low_z + 0.001, abs=1e-3)
                for (low_x, low_y, low_z), (high_x, high_y, _) in ((top.low, top.high) for top in tops)
            )
        middles = np.array([thing.position for thing in layout.objects])
        distances = np.linalg.norm(middles[:, np.newaxis] - middles, axis=-1) + np.eye(len(middles))
        assert distances.min() >= 0.13 - 1e-3
        kinds |= {thing.kind for thing in layout.objects}
        counts.add(len(layout.objects))
        places |= {place.kind for place in layout.places_in(design)}
    assert kinds == {*OBJECTS}
    assert counts == {2, 3, 4, 5}
    assert places == SURFACES | {"drawer", "cabinet", "microwave"}


def test_designs_keep_their_json_their_digest_and_their_certificates():
    # Those that kitchens had before there were objects.
    digests = {("train", 0): "f52d3345e194c5c8", ("train", 5): "6552d233d0ef67f4", ("test", 7): "c2c8e341515b7cc1"}
    for (split, number), expected in digests.items():
        design = build_pick_and_place(number, split, visuals=False).design
        assert design == KitchenDesign.make(number, split)
        assert design_digest(design) == expected == certificate_of(design).digest


def test_the_default_kitchen_has_a_task_for_each_verb():
    scene = build_pick_and_place(visuals=False)
    assert scene.design == KitchenDesign.make(DEFAULT_DESIGN, "train")
    for verb in VERBS:
        assert tasks_of(scene, [verb])


def test_a_layout_in_json_is_read_and_written():
    layout = ObjectLayout.make(LAYOUT, MINE)
    assert layout.names == ("can", "mug", "can_2")
    assert json.loads(json.dumps(layout.to_json())) == {**LAYOUT, "objects": LAYOUT["objects"]}
    assert ObjectLayout.make(json.loads(json.dumps(layout.to_json())), MINE) == layout
    assert ObjectLayout.make(layout, MINE) is layout


THING = LAYOUT["objects"][0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objects": [THING]}, "`$.objects`"),
        ({"objects": [THING] * 6}, "`$.objects`"),
        ({"objects": [THING] * 3}, "objects must have a kind at most twice, got 3 of 'can'"),
        ({"objects": [THING, {**THING, "kind": "cup"}]}, "'cup'"),
        ({"objects": [THING, {**THING, "yaw": 4.0}]}, "`$.objects[1].yaw`"),
        ({"objects": [THING, {**THING, "position": [0, 0]}]}, "`$.objects[1].position`"),
        ({"objects": [THING, {**THING, "mass": 1.0}]}, "`mass`"),
        ({"objects": [THING, {"kind": "can", "yaw": 0.0}]}, "`position`"),
        ({"tray": [0.0, 0.6]}, "`$.tray`"),
        ({"trays": 1}, "`trays`"),
        ({"places": []}, "`$.places`"),
        ({"places": ["tray", "tray"]}, "places of objects"),
        ({"places": ["drawers_1/drawer_3"]}, "place of objects 'drawers_1/drawer_3' does not exist (did you mean"),
        ({"tray": None}, "place of objects 'tray' does not exist"),
    ],
)
def test_a_wrong_layout_is_refused_with_its_place(change, message):
    with refused(ValueError, message) as raised:
        ObjectLayout.make({**LAYOUT, **change}, MINE)
    assert_is_short(str(raised.value))


@pytest.mark.parametrize("value", ODD_VALUES.values(), ids=ODD_VALUES)
def test_an_odd_layout_is_refused_in_a_short_line(value):
    for layout in (value, {**LAYOUT, "objects": value}, {**LAYOUT, "tray": value}, {**LAYOUT, "places": value}):
        with pytest.raises((ValueError, TypeError)) as raised:
            ObjectLayout.make(layout, MINE)
        assert_is_short(str(raised.value))


def test_the_scene_has_what_the_layout_says():
    scene = build_pick_and_place(DESIGN, objects=LAYOUT, visuals=False)
    PickAndPlaceTask(scene)
    assert [type(thing) for thing in scene.objects] == [OBJECTS[each["kind"]] for each in LAYOUT["objects"]]
    assert tuple(place.name for place in scene.places) == tuple(LAYOUT["places"])
    assert scene.object_words == ("left can", "mug", "right can")
    # Parts are those of the kitchen without objects.
    assert scene.part_names == build_generated_kitchen(MINE, visuals=False).part_names
    for place in scene.places:
        assert (np.array(place.low) < place.high).all()


def test_places_are_in_words_of_their_fixtures():
    words = {name: place.words for name, place in places_of(MINE).items()}
    assert words["stove_1/burner_3"] == "front right burner of the stove"
    assert words["drawers_1/drawer_2"] == "bottom drawer of the cabinet"
    assert words["wall_doors_1/inside"] == "wall cabinet"
    assert words["drawers_1/worktop"] == "top of the cabinet"


def test_a_turned_tray_is_a_place_as_it_lies():
    for yaw, half in ((0.0, (0.13, 0.09)), (-1.5708, (0.09, 0.13))):
        layout = copy.deepcopy(LAYOUT)
        layout["tray"][3] = yaw
        (tray, *_) = ObjectLayout.make(layout, MINE).places_in(MINE)
        np.testing.assert_allclose(np.subtract(tray.high, tray.low)[:2] / 2, half, atol=1e-6)
        assert tray.low[2] == pytest.approx(1.706)
