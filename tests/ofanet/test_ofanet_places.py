"""Frames of a measurement at their places in a network for more frames."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from ofanet_init import places

few = st.integers(1, 4)
sizes = st.tuples(few, st.integers(1, 12))


@given(given_size=sizes, views=few, frames=st.integers(1, 12))
def test_each_frame_has_a_place_of_its_own_if_there_are_enough(given_size, views, frames):
    where = places.places(given_size, views, frames)
    each = views // given_size[0]
    assert (where is None) == (given_size[1] > each * frames)
    if where is not None:
        assert len(set(where)) == given_size[0] * given_size[1]
        assert 0 <= min(where) <= max(where) < views * frames
        views_of = np.reshape(where, given_size) // frames
        owners = [set(row) for row in views_of.tolist()]
        assert sum(map(len, owners)) == len(set().union(*owners)), "no two views share a view of the network"


@given(size=sizes)
def test_a_network_of_this_size_has_the_frames_in_order(size):
    assert places.places(size, *size) == list(range(size[0] * size[1]))


@given(size=sizes, views=few, frames=st.integers(1, 12))
def test_what_is_placed_can_be_taken(size, views, frames):
    assume(places.places(size, views, frames))
    planes = 1 + np.arange(size[0] * size[1] * 6.0).reshape(*size, 2, 3)
    whole = places.placed(planes, views, frames)
    assert whole.shape == (views, frames, 2, 3)
    assert np.count_nonzero(whole) == planes.size, "the other places are empty"
    assert np.array_equal(places.taken(whole, size), planes)
