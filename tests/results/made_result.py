"""A small result for tests: ``from made_result import RECORDS, make``."""

import numpy as np

from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result

RECORDS = [Record(1, 0.5, 0.25, 0.1, 20.5), Record(2, 1.0, 0.125, 0.05, 21.0, 0.75)]


def make(shape=(2, 3, 8, 6), dtype=np.float32, status=Status.CONVERGED, **kept):
    """A random video of two iterations, with other attributes as given."""
    x = np.random.default_rng(0).random(shape).astype(dtype)
    kept = {"history": History(RECORDS), "settings": {"prior": "tv", "seed": 0, "noise": None}, **kept}
    return Result(x, status, **kept)
