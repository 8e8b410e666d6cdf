"""Draws of the tasks that an episode asks for, and their order."""

import collections
import itertools

import numpy as np

from kitchen_suite.tasks.orders import TaskDraw, order_of, sequence_of


def draws(least, most, weights, count=4000):
    """Returns the indices of the tasks asked, in order, of many draws."""
    random_state, draw = np.random.RandomState(0), TaskDraw(least=least, most=most)
    return [sequence_of(draw.draw(random_state, np.array(weights, float))) for _ in range(count)]


def test_every_ordered_choice_is_equally_likely():
    counts = collections.Counter(map(tuple, draws(2, 2, [1.0] * 4)))
    assert set(counts) == set(itertools.permutations(range(4), 2))
    # Five standard errors of a share of 1/12.
    assert all(abs(count - 4000 / 12) < 5 * np.sqrt(4000 / 12) for count in counts.values())


def test_every_number_of_tasks_is_equally_likely():
    counts = collections.Counter(map(len, draws(1, 4, [1.0] * 5)))
    assert set(counts) == {1, 2, 3, 4}
    assert all(abs(count - 1000) < 5 * np.sqrt(1000 * 0.75) for count in counts.values())


def test_weights_are_probabilities_of_the_first_draw():
    counts = collections.Counter(index for (index,) in draws(1, 1, [1.0, 0.0, 3.0, 4.0]))
    assert set(counts) == {0, 2, 3}
    for index, share in ((0, 1 / 8), (2, 3 / 8), (3, 4 / 8)):
        assert abs(counts[index] - 4000 * share) < 5 * np.sqrt(4000 * share * (1 - share))


def test_weights_leave_the_order_and_the_random_numbers_unchanged():
    one, other = np.random.RandomState(3), np.random.RandomState(3)
    draw = TaskDraw(least=2, most=3)
    first = draw.draw(one, np.ones(4))
    np.testing.assert_array_equal(draw.draw(other, 7.0 * np.ones(4)), first)
    draw.draw(one, np.ones(4))
    draw.draw(other, np.array([0.0, 1.0, 0.1, 100.0]))
    assert one.random_sample() == other.random_sample()
    heavy = [asked for asked in draws(2, 2, [100.0, 1.0, 1.0]) if 0 in asked]
    # The heavy task is as often the first as the second.
    assert abs(sum(asked[0] == 0 for asked in heavy) - len(heavy) / 2) < 5 * np.sqrt(len(heavy) / 4)


def test_an_order_and_its_indices_are_inverse():
    np.testing.assert_array_equal(order_of([3, 0], 5), [1, -1, -1, 0, -1])
    assert sequence_of(order_of([3, 0], 5)) == [3, 0]
