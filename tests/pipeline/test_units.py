"""A truth in other units than the result is noticed; white may be any value."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.errors import InputError

SCENE = pnp_sci.datasets.embedded_scene(32)


def test_grey_levels_of_floats():
    """MATLAB scripts of the field keep 0 to 255 as doubles, y in the same units."""
    plain = pnp_sci.solve(SCENE.y, SCENE.masks, iterations=3, reference=SCENE.truth)
    levels = 255 * SCENE.truth.astype(float)
    grey = pnp_sci.solve(255 * SCENE.y, SCENE.masks, iterations=3, reference=levels)
    assert grey.history[-1].psnr == pytest.approx(plain.history[-1].psnr, abs=0.01)
    assert not any("times the reference" in remark for remark in grey.remarks)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_cameras_of_any_bits_store_uint16(bits):
    """PSNR is that of floats; what white was taken for is said, where it is not that of the type."""
    white = 2**bits - 1
    plain = pnp_sci.solve(SCENE.y, SCENE.masks, iterations=3, reference=SCENE.truth)
    levels = np.round(white * SCENE.truth).astype(np.uint16)
    y = pnp_sci.simulate(levels, SCENE.masks)
    for peak in (None, white):
        grey = pnp_sci.solve(y, SCENE.masks, iterations=3, reference=levels, peak=peak)
        assert grey.history[-1].psnr == pytest.approx(plain.history[-1].psnr, abs=0.05)
        assert [f"white is taken to be {white}" in remark for remark in grey.remarks] == [True] * (
            peak is None and bits < 16
        )


def test_floats_a_little_above_one_are_not_of_eight_bits():
    """White would be 255, and PSNR 48 dB too high."""
    with pytest.raises(InputError, match=r"reference spans 0 to 1\.0.*peak= says what is white"):
        pnp_sci.solve(1.05 * SCENE.y, SCENE.masks, iterations=1, reference=1.05 * SCENE.truth)
    (told,) = pnp_sci.solve(200 * SCENE.y, SCENE.masks, iterations=3, reference=200 * SCENE.truth).remarks
    assert "in float32: white is taken to be 255; peak= says otherwise" in told


def test_peak_says_what_is_white():
    half = pnp_sci.solve(SCENE.y / 2, SCENE.masks, iterations=3, reference=SCENE.truth / 2, peak=0.5)
    plain = pnp_sci.solve(SCENE.y, SCENE.masks, iterations=3, reference=SCENE.truth)
    assert half.history[-1].psnr == pytest.approx(plain.history[-1].psnr, abs=0.01)
    x = SCENE.truth * 0.9
    np.testing.assert_allclose(pnp_sci.psnr(4 * x, 4 * SCENE.truth, peak=4), pnp_sci.psnr(x, SCENE.truth), rtol=1e-5)
    with pytest.raises(InputError, match="peak"):
        pnp_sci.psnr(x, SCENE.truth, peak=0)
    with pytest.raises(InputError, match="peak"):
        pnp_sci.solve(SCENE.y, SCENE.masks, reference=SCENE.truth, peak=-1)


def test_other_units_are_noticed_with_the_gain():
    counts = pnp_sci.solve(1000 * SCENE.y, SCENE.masks, iterations=3, reference=SCENE.truth)
    (remark,) = (remark for remark in counts.remarks if "times the reference" in remark)
    gain = float(remark.split("the result is ")[1].split()[0])
    assert 800 < gain < 1100
    assert "PSNR is" in remark
    assert remark in repr(counts)
