"""What a result says of itself is read wherever a result is shown."""

import numpy as np

import pnp_sci
from pnp_sci import Result
from pnp_sci.results.history import History, Record, Status


def result(*remarks):
    scenes = [{"remarks": list(r)} for r in remarks]
    return Result(np.ones((1, 1, 8, 8)), Status.CONVERGED, History([Record(1, 0.1, 0.1, 0.0)]), {}, scenes)


def test_a_remark_is_in_every_text():
    made = result(["two pixels are hot"])
    for text in (repr(made), str(made), made._repr_html_()):
        assert "two pixels are hot" in text


def test_of_several_measurements_it_is_said_which():
    assert result(["a"], ["a", "b"], []).remarks == ["measurement 1, 2: a", "measurement 2: b"]
    assert result(["a"], ["a"]).remarks == ["a"]


def test_a_still_scene_is_said_to_be_modelled_by_one_frame():
    still = np.repeat(pnp_sci.datasets.embedded_scene(64).truth[:, :1], 10, axis=1)
    masks = pnp_sci.random_masks(still.shape, seed=1)
    made = pnp_sci.solve(pnp_sci.simulate(still, masks), masks)
    assert made.scene["still"] is True
    assert "one frame per view" in repr(made)
