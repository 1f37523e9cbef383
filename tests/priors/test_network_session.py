"""A network at work inside a solver: what it is told, and how it sees the frames."""

import numpy as np
import pytest

from pnp_sci.plugins.combine import FunctionSession
from priors.session import NetworkSession


class Net:
    """Returns what it sees, and keeps what it was told."""

    hashes, still = ["0" * 64], [0.25]

    def __init__(self):
        self.sigmas, self.turns = [], []

    def __call__(self, x, sigma, turn):
        self.sigmas.append(sigma)
        self.turns.append(turn)
        return x.copy()

    def finish(self, x, sigma):
        return x + sigma


def begun(stronger=1.5, turn=0):
    """A session, its network, and a list of what is asked of the total variation beside it, which does nothing."""
    net, beside = Net(), []
    total_variation = FunctionSession(lambda v, sigma: beside.append(sigma) or v)
    return NetworkSession(net, total_variation, stronger, turn), net, beside


@pytest.fixture
def noise():
    """Two views (2, 3, 16, 16) of noise."""
    return np.random.default_rng(0).standard_normal((2, 3, 16, 16)).astype(np.float32)


def test_the_network_is_told_more_than_the_solver_says_up_to_a_limit():
    """What it is not told is left to total variation."""
    session, net, beside = begun(stronger=1.5)
    x = np.zeros((1, 2, 8, 8), np.float32)
    for sigma in (0.02, 0.5, 5.0):
        session(x, sigma)
    low, most, again = net.sigmas
    assert low == pytest.approx(1.5 * 0.02)
    assert 0.1 < most == again < 1.5 * 0.5
    assert beside == pytest.approx([0.02, 0.5 * (1.5 * 0.5 / most), 5.0 * (1.5 * 5.0 / most)])


def test_every_call_in_a_row_of_eight_is_seen_in_another_way():
    session, net, _ = begun(turn=30)
    for _ in range(16):
        session(np.zeros((1, 1, 8, 8)), 0.05)
    assert {turn % 8 for turn in net.turns[:8]} == {turn % 8 for turn in net.turns[8:]} == set(range(8))


def test_the_input_stays_as_it_is(noise):
    session, before = begun()[0], noise.copy()
    for _ in range(3):
        session(noise, 0.05)
    np.testing.assert_array_equal(noise, before)


def test_without_noise_the_input_comes_back_and_nothing_is_told(noise):
    session, net, beside = begun()
    session(np.zeros_like(noise), 0.05)
    np.testing.assert_array_equal(session(noise, 0.0), noise)
    assert len(net.sigmas) == len(beside) == 1


def test_the_network_finishes_and_tells_its_weights():
    session, net, _ = begun()
    x = np.ones((1, 1, 8, 8), np.float32)
    session(x, 0.05)
    np.testing.assert_array_equal(session.finish(x, 0.5), x + 0.5)
    assert session.facts() == {"weights": net.hashes, "still": net.still}
