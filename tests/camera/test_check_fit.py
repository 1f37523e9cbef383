"""Masks that do not fit are noticed, and those that fit raise no alarm."""

import json
import logging

import numpy as np
import pytest
from moved import moved, seen_through
from scipy.ndimage import gaussian_filter, shift

import pnp_sci
from pnp_sci import SensingOperator, Sensor, check_fit, datasets, moving_masks, random_masks, simulate, solve
from pnp_sci.camera.code import Code
from pnp_sci.camera.mask_frames import repeated_frames


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


def kinds(y, masks, **options):
    return [finding.kind for finding in check_fit(y, masks, **options).findings]


def made(masks, scene):
    """The film of the scene, for masks (V, B, H, W) of any number of views and frames."""
    views, frames, rows, columns = masks.shape
    film = np.concatenate([scene.truth, scene.truth[:, ::-1]], 1)
    return np.stack([film[v % 2, :frames, :rows, :columns] for v in range(views)])


SHAPES = [(1, 1, 128, 128), (1, 8, 128, 128), (2, 10, 128, 128), (3, 5, 100, 90), (1, 20, 64, 64), (1, 8, 32, 32)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("noise", [0, 0.01, 0.1])
@pytest.mark.parametrize("density", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("make", [random_masks, moving_masks])
def test_right_masks_raise_no_alarm(scene, shape, noise, density, make):
    masks = make(shape, density, seed=5)
    assert kinds(simulate(made(masks, scene), masks, noise, seed=1), masks) == []


@pytest.mark.parametrize("signed", [False, True])
def test_grey_and_negative_masks_raise_no_alarm(scene, signed):
    masks = np.random.default_rng(0).uniform(-1.0 if signed else 0.2, 1, (2, 8, 128, 128))
    assert kinds(simulate(made(masks, scene), masks, 0.01), masks) == []


def complement(first, leak=0.0):
    """Masks (2, B, H, W) of a mirror that sends the light of each element to one of two sides, with stray light."""
    return leak + (1 - 2 * leak) * np.stack([first, 1 - first]).astype(np.float32)


@pytest.mark.parametrize("noise", [0, 0.01, 0.1])
@pytest.mark.parametrize("leak", [0, 0.05])
@pytest.mark.parametrize("contrast", [0.1, 1])
def test_masks_of_two_views_that_complement_each_other_raise_no_alarm(scene, noise, leak, contrast):
    """Bug: they were another setup's, inverted, or upside down, and pixels were hot. The sum of both is constant."""
    masks = complement(scene.masks[0], leak)
    truth = 0.45 + contrast * (scene.truth - 0.45)
    fit = check_fit(simulate(truth, masks, noise, seed=1), masks)
    assert fit.ok, fit.warnings
    assert (fit.follows, fit.black_level) == (None, None)
    assert "complement each other" in fit.unknown
    assert not fit.bad.any()
    third = np.concatenate([masks, random_masks((1, *masks.shape[1:]), seed=3)])
    assert kinds(simulate(made(third, scene), third, noise, seed=1), third) == []


def test_masks_that_complement_each_other_and_are_shifted_are_noticed(scene):
    masks, truth = complement(scene.masks[0]), scene.truth * np.array([1, 0.2])[:, None, None, None]
    assert kinds(simulate(truth, masks), np.roll(masks, (2, 3), (2, 3))) == ["shift"]


def test_what_tells_the_light_is_said_of_each_kind_of_masks(scene):
    one = scene.masks[:1]
    same = np.concatenate([one, one])
    for masks in (one, scene.masks, same):
        assert Code(masks.sum(1, dtype=np.float32)).tells_light
    for masks in (complement(one[0]), np.concatenate([one, np.ones_like(one)])):
        assert not Code(masks.sum(1, dtype=np.float32)).tells_light
    good = np.ones(one.shape[2:], bool)
    good[5, 7] = False
    grey = np.concatenate([one, np.full_like(one, 0.3, np.float32)]).sum(1, dtype=np.float32)
    assert not Code(grey, good).tells_light, "rounding is no detail"


WRONG = {
    "half a pixel off": (lambda m: shift(m, (0, 0, 0.5, 0.5), order=1, mode="nearest"), {"shift"}),
    "a pixel off": (lambda m: np.roll(m, (1, 1), (2, 3)), {"shift"}),
    "far off": (lambda m: np.roll(m, (30, -17), (2, 3)), {"shift"}),
    "upside down": (lambda m: m[:, :, ::-1], {"arrangement"}),
    "left to right": (lambda m: m[..., ::-1], {"arrangement"}),
    "turned": (lambda m: np.rot90(m, 1, (2, 3)), {"arrangement"}),
    "transposed": (lambda m: m.swapaxes(2, 3), {"arrangement"}),
    "of another setup": (lambda m: random_masks(m.shape, seed=9), {"no code"}),
    "inverted": (lambda m: 1 - m, {"inverted"}),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("noise", [0, 0.1])
@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("views", [1, 2])
def test_wrong_masks_are_noticed(scene, name, noise, make, views):
    change, expected = WRONG[name]
    masks = make((views, 10, 128, 128), seed=3).astype("f4")
    y = simulate(scene.truth[:views], masks, noise, seed=1)
    assert set(kinds(y, change(masks))) == expected


@pytest.mark.parametrize("noise", [0, 0.1])
def test_a_mask_that_moved_by_a_fraction_of_a_pixel_is_noticed(scene, noise):
    masks = random_masks((1, 10, 128, 128), seed=3).astype("f4")
    y = 1.02 * simulate(scene.truth[:1], shift(masks, (0, 0, 0.5, 0.3), order=1, mode="nearest"), noise) + 0.002
    fit = check_fit(y, masks)
    assert [finding.kind for finding in fit.findings] == ["shift"]
    assert "register" in fit.warnings[0]
    rows, columns = fit.shift
    assert rows > columns > 0


@pytest.mark.parametrize("motion", [{"degrees": 0.3}, {"degrees": -0.4}, {"scale": 1.006}, {"scale": 0.993}])
@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("views", [1, 2])
def test_masks_turned_or_magnified_a_little_are_noticed(scene, motion, make, views):
    """Bug: the code is weaker towards the edges, which was told as gamma or as a black level."""
    masks = make((views, 10, 128, 128), seed=3)
    (finding,) = check_fit(seen_through(moved(masks, **motion), scene.truth[:views]), masks).findings
    assert finding.kind == "shift"
    assert "turned or magnified" in finding.text
    assert "register" in finding.hint


def test_where_part_of_the_light_follows_no_mask_registration_is_named_first(scene):
    masks = random_masks((1, 10, 128, 128), seed=3)
    soft = gaussian_filter(masks.astype("f4"), (0, 0, 0.5, 0.5))
    (finding,) = check_fit(simulate(scene.truth[:1], 0.1 + 0.8 * soft), masks).findings
    assert "register" in finding.hint.split("; or ")[0]


def test_shifts_point_to_where_the_masks_belong(scene):
    masks = random_masks((1, 10, 128, 128), seed=3)
    y = simulate(scene.truth[:1], masks)
    assert check_fit(y, np.roll(masks, (2, -3), (2, 3))).shift == (-2, 3)
    assert "upside down, moved by" in check_fit(y, np.roll(masks[:, :, ::-1], 2, 2)).warnings[0]


def along(path):
    """Masks (1, B, 128, 128) of a random pattern, cut at the places of a path (B, 2)."""
    pattern = np.random.default_rng(0).random((160, 160)) < 0.5
    return np.stack([pattern[top : top + 128, left : left + 128] for top, left in path])[None]


@pytest.mark.parametrize("step", [(1, 0), (0, -2), (1, 1), (0, 1)])
def test_masks_that_move_the_other_way_are_told_from_moved_ones(scene, step):
    """The sum of such masks is a moved sum of the right ones, but their frames run backwards."""
    path = 16 + np.arange(8)[:, None] * step
    right, wrong = along(path), along(32 - path)
    fit = check_fit(simulate(made(right, scene), right, 0.005), wrong)
    (finding,) = fit.findings
    assert (finding.kind, finding.text[:30]) == ("shift", "masks that move the other way ")
    shift = tuple(-7 * np.array(step))
    mended = np.roll(wrong, shift, (2, 3))[:, ::-1]
    assert np.mean(mended[..., 16:-16, 16:-16] == right[..., 16:-16, 16:-16]) == 1
    assert "({}, {})".format(*shift) in finding.text


@pytest.mark.parametrize("views", [1, 2])
def test_a_path_that_meets_the_right_one_in_one_frame_is_no_shift(scene, views):
    """Bug: the masks were to be moved to where one frame fits."""
    steps = np.arange(8)
    right, wrong = along(np.stack([steps, steps], 1)), along(np.stack([steps, 7 - steps], 1))
    if views == 2:
        right, wrong = (np.concatenate([masks, masks[..., ::-1, ::-1]]) for masks in (right, wrong))
    fit = check_fit(simulate(made(right, scene), right), wrong)
    assert [f.kind for f in fit.findings] == ["no code"]
    assert fit.shift is None


@pytest.mark.parametrize("noise", [0, 0.03])
def test_a_measurement_divided_by_the_sum_of_masks_is_noticed(scene, noise):
    total = scene.masks.sum((0, 1))
    y = simulate(scene.truth, scene.masks, noise) / np.maximum(total, 1)
    assert kinds(y, scene.masks) == ["no code"]


@pytest.mark.parametrize("part", [0.2, 0.5, -0.2])
@pytest.mark.parametrize("density", [0.3, 0.7])
def test_the_black_level_is_measured(scene, part, density):
    masks = random_masks((2, 10, 128, 128), density, seed=4)
    clean = simulate(scene.truth, masks, 0.01)
    offset = part * float(clean.mean())
    fit = check_fit(clean + offset, masks)
    assert [finding.kind for finding in fit.findings] == ["black level" if part > 0 else "contrast"]
    assert (1 - fit.follows) * float(np.mean(clean + offset)) == pytest.approx(offset, abs=0.06 * float(clean.mean()))
    assert part < 0 or fit.black_level == pytest.approx(offset, abs=0.06 * float(clean.mean()))


@pytest.mark.parametrize("gamma", [1.5, 2.2])
@pytest.mark.parametrize("density", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("noise", [0, 0.02])
def test_a_gamma_is_no_black_level(scene, gamma, density, views, noise):
    """Nothing must be subtracted, as the line of light against the mean of y goes through the origin."""
    masks = random_masks((views, 10, 128, 128), density, seed=4)
    y = np.maximum(simulate(scene.truth[:views], masks, noise), 0)
    fit = check_fit(y ** (1 / gamma), masks)
    assert [finding.kind for finding in fit.findings] == ["contrast"]
    assert "switch off gamma" in fit.warnings[0]
    assert "subtract" not in fit.warnings[0]
    assert fit.black_level is None
    offset = check_fit(y + 0.5 * y.mean(), masks)
    assert [finding.kind for finding in offset.findings] == ["black level"]
    assert "gamma" not in offset.warnings[0]


def test_where_gamma_and_black_level_look_the_same_both_are_named(scene):
    even = simulate(np.ones((1, 10, 128, 128)), scene.masks[:1])
    (warning,) = check_fit(even ** (1 / 2.2), scene.masks[:1]).warnings
    assert "subtract the black level" in warning
    assert "switch off gamma" in warning


@pytest.mark.parametrize("part", [0.5, 0.6, 0.8, 1.0, 1.2])
@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("views", [1, 2])
def test_too_much_that_was_subtracted_is_noticed_however_much(scene, part, noise, views):
    masks = scene.masks[:views]
    y = simulate(scene.truth[:views], masks, noise)
    fit = check_fit(y - part * y.mean(), masks)
    assert [finding.kind for finding in fit.findings] == ["contrast"]
    assert "subtracted" in fit.warnings[0]
    assert not str(fit).startswith("Fit of masks and measurement: good")


WRONG_SIGNS = {
    "of the other sign": (lambda y: -y, "sign may be wrong"),
    "far below 0": (lambda y: y - 2 * y.mean(), "too much may be subtracted"),
    "uint16 as int16": (
        lambda y: (y * 40000 / y.max()).astype(np.uint16).view(np.int16),
        "as int16; read them as uint16",
    ),
    "uint8 as int8": (lambda y: (y * 200 / y.max()).astype(np.uint8).view(np.int8), "as int8; read them as uint8"),
}


@pytest.mark.parametrize("name", WRONG_SIGNS)
@pytest.mark.parametrize("noise", [0.001, 0.05])
@pytest.mark.parametrize("views", [1, 2])
def test_negative_measurements_are_noticed(scene, name, noise, views):
    change, told = WRONG_SIGNS[name]
    masks = random_masks((views, 10, 128, 128), seed=3)
    y = np.maximum(simulate(scene.truth[:views], masks, noise), 0)
    fit = check_fit(change(y), masks)
    assert [finding.kind for finding in fit.findings] == ["sign"]
    assert told in fit.warnings[0]


@pytest.fixture(scope="module")
def raw(scene):
    """Counts of a scene with a dark part, and a black level of 20."""
    counts = simulate(scene.truth * (np.arange(128) >= 40)[:, None], scene.masks)
    return np.random.default_rng(0).normal(120 * counts / counts.max() + 20, 2).round()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("gone", [18, 20, 23])
def test_differences_of_unsigned_numbers_that_have_wrapped_are_noticed(scene, raw, dtype, gone):
    counts = raw.astype(dtype)
    y = counts - dtype(gone)
    assert y.max() == np.iinfo(dtype).max
    (finding,) = check_fit(y, scene.masks).findings
    assert finding.kind == "sign"
    assert f"difference of {np.dtype(dtype)} numbers" in finding.text + finding.hint
    assert not any("wrapped" in warning for warning in check_fit(counts.astype(float) - gone, scene.masks).warnings)


@pytest.mark.parametrize(
    "hot", [65535, np.linspace(40000, 65535, 60), np.linspace(60000, 65535, 60), np.r_[65535, [65400] * 59]]
)
def test_hot_pixels_and_saturation_of_16_bits_have_not_wrapped(scene, raw, hot):
    y = raw.copy()
    y.flat[np.random.default_rng(1).permutation(y.size)[:60]] = hot
    assert not any("wrapped" in warning for warning in check_fit(y.astype(np.uint16), scene.masks).warnings)
    saturated = np.minimum(raw * 700, 65535).astype(np.uint16)
    assert not any("wrapped" in warning for warning in check_fit(saturated, scene.masks).warnings)


@pytest.mark.parametrize("noise", [0, 0.005])
@pytest.mark.parametrize("views", [1, 2])
def test_centred_masks_are_noticed(scene, noise, views):
    masks = random_masks((views, 10, 128, 128), seed=3).astype("f4")
    y = simulate(scene.truth[:views], masks, noise)
    for centred in (2 * masks - 1, (masks - masks.mean()) / masks.std()):
        (warning,) = check_fit(y, centred).warnings
        assert "centred" in warning


def test_masks_that_do_not_change_are_noticed(scene):
    one = random_masks((1, 1, 128, 128))
    for masks in (np.ones((1, 8, 128, 128)), np.repeat(one, 8, 1)):
        assert kinds(simulate(scene.truth[:1, :8], masks), masks) == ["static"]
    two = np.concatenate([random_masks((1, 8, 128, 128), seed=2), np.repeat(one, 8, 1)])
    (warning,) = check_fit(simulate(scene.truth[:, :8], two), two).warnings
    assert "view 2" in warning
    assert kinds(simulate(scene.truth[:1, :1], one), one) == []


@pytest.mark.parametrize("noise", [0, 0.02])
def test_masks_that_repeat_are_noticed(scene, noise):
    """Within a view, or in the other one; calibrated masks repeat but for their noise."""
    masks = random_masks((2, 10, 128, 128), seed=2).astype("f4")
    within, beside = masks.copy(), masks.copy()
    within[1, 7], beside[1] = masks[1, 2], np.roll(masks[0], 4, 0)
    for repeated, first, second, more in ((within, "view 2, frame 3", "view 2, frame 8", ""),
                                          (beside, "view 1, frame 1", "view 2, frame 5", "9 other pairs")):  # fmt: skip
        calibrated = repeated + noise * np.random.default_rng(0).random(masks.shape)
        (warning,) = check_fit(simulate(scene.truth, repeated), calibrated).warnings
        assert f"in {first} and in {second}" in warning
        assert more in warning
    assert kinds(simulate(scene.truth, masks), masks) == []


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("frames", [2, 3, 20])
def test_masks_that_are_alike_do_not_repeat(make, frames):
    """Blurred patterns that move, with stray light, beside a lens that vignettes."""
    blurred = gaussian_filter(make((2, frames, 64, 64)).astype("f4"), (0, 0, 2, 2))
    dark = np.hypot(*np.ogrid[-1:1:64j, -1:1:64j]) ** 2 / 2
    for masks in (blurred, 0.5 + 0.5 * blurred, blurred * (1 - dark), blurred[:1], 1 - blurred):
        assert repeated_frames(masks) == ()


def test_views_that_cannot_be_told_apart_are_noticed(scene):
    masks = scene.masks.astype("f4")
    for second in (masks[0], 0.5 * masks[0], 0 * masks[0]):
        alike = np.stack([masks[0], second])
        result = solve(simulate(scene.truth, alike), alike, iterations=1)
        assert any("cannot be told apart" in remark for remark in result.remarks)


def test_the_view_whose_masks_are_wrong_is_named(scene):
    masks = scene.masks.copy()
    masks[1] = np.roll(masks[1], 2, -1)
    (warning,) = check_fit(scene.y, masks).warnings
    assert "of view 2" in warning
    assert "register" in warning


@pytest.mark.parametrize(
    "noise", [25.0, 1e9, pnp_sci.Sensor(read_noise=0.05, gain=1000), pnp_sci.Sensor(read_noise=90)]
)
def test_noise_that_y_cannot_hold_is_noticed(scene, noise):
    assert kinds(scene.y, scene.masks, noise=noise) == ["noise"]


def test_noise_that_y_holds_is_none(scene):
    noise = np.random.default_rng(0).standard_normal(scene.y.shape)
    for sigma in (0.01, 1.0, 100.0):
        assert kinds(sigma * noise, scene.masks, noise=sigma) == []
        assert "noise" not in kinds(np.maximum(sigma * noise, 0), scene.masks, noise=sigma)
    dim = pnp_sci.Sensor(read_noise=0.0, gain=1.0)
    for light in (0.001, 0.1, 10):
        assert "noise" not in kinds(dim.expose(light * scene.y), scene.masks, noise=dim)


def test_follows_is_unbiased_within_its_standard_error(scene):
    """Over many masks the deviation from 1 is as large as the standard error says, or smaller."""
    fits = []
    for seed in range(30):
        masks = random_masks((1, 8, 96, 96), seed=seed)
        fits.append(check_fit(simulate(made(masks, scene), masks, 0.05, seed), masks))
    deviations = np.array([(fit.follows - 1) / fit.error for fit in fits])
    assert abs(deviations.mean()) < 3 / np.sqrt(30)
    assert np.abs(deviations).max() < 4


def test_what_cannot_be_told_is_said(scene):
    half = random_masks((1, 1, 128, 128))
    constant = np.concatenate([half, ~half], 1)
    fit = check_fit(simulate(scene.truth[:1, :2], constant), constant)
    assert fit.ok
    assert fit.follows is None
    assert "sums" in fit.unknown
    assert "cannot be told" in str(fit)
    dark = check_fit(np.zeros((128, 128)), scene.masks)
    assert [finding.kind for finding in dark.findings] == ["empty"]
    assert dark.unknown == "y is 0 everywhere"
    bad = np.zeros((128, 128), bool)
    bad[3, 4] = True
    assert "not bad" in check_fit(np.where(bad, 1.0, 0.0), scene.masks, bad=bad).findings[0].text


def test_missing_planes_and_measurements_are_noticed(scene):
    masks = scene.masks.copy()
    masks[0, 5:] = 0
    fit = check_fit(scene.y, masks)
    assert fit.findings[0].kind == "missing"
    assert "view 1, frames 6, 7, 8, 9, 10" in fit.warnings[0]
    for y in (scene.y, 0 * scene.y):
        closed = check_fit(y, 0 * scene.masks)
        assert closed.warnings == ("masks are all 0: parts of their file may be missing",)
    fits = check_fit(np.stack([scene.y, 0 * scene.y]), scene.masks)
    assert [[finding.kind for finding in fit.findings] for fit in fits] == [[], ["empty"]]


def test_the_order_of_frames_is_told_by_successive_measurements():
    long = datasets.embedded_scene(64)
    masks = random_masks((2, 5, 64, 64))
    y = np.stack([simulate(long.truth[:, :5], masks), simulate(long.truth[:, 5:], masks)])
    assert [fit.frame_order for fit in check_fit(y, masks, frame_order=True)] == ["forward"] * 2
    backwards = check_fit(y, masks[:, ::-1], frame_order=True)
    assert [fit.frame_order for fit in backwards] == ["reversed"] * 2
    assert backwards[0].findings[-1].kind == "frame order"
    assert check_fit(y[0], masks, frame_order=True).frame_order == "unknown"
    assert check_fit(y, masks)[0].frame_order == "not checked"


def test_all_of_it_is_json_and_text(scene):
    for y, masks in ((scene.y, scene.masks), (scene.y, scene.masks[:, :, ::-1]), (0 * scene.y, scene.masks)):
        fit = check_fit(y, masks)
        assert json.loads(json.dumps(fit.describe()))["findings"] == [vars(finding) for finding in fit.findings]
        assert all(warning in str(fit) for warning in fit.warnings)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_units_do_not_matter(scene, scale):
    y, masks = scene.y.astype("f8"), scene.masks.astype("f8")
    assert check_fit(scale * y, masks).follows == pytest.approx(check_fit(y, masks).follows, rel=1e-5)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 4, 5), (1, 2, 1, 300), (1, 2, 15, 15), (3, 1, 16, 40)])
@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_it_never_fails(shape, value):
    rng = np.random.default_rng(0)
    for masks in (np.full(shape, value), rng.standard_normal(shape), rng.random(shape) < 0.5):
        for y in (np.full(shape[2:], value), rng.standard_normal(shape[2:]), 1e30 * rng.random(shape[2:])):
            assert str(check_fit(y.astype("f4"), masks))


def test_solve_and_decode_say_it(scene, caplog):
    flipped = scene.masks[:, :, ::-1]
    with caplog.at_level(logging.WARNING, "pnp_sci"):
        result = pnp_sci.solve(np.stack([scene.y, scene.y]), flipped, iterations=1)
    (text,) = check_fit(scene.y, flipped).warnings
    assert [record.message for record in caplog.records] == [f"measurements 1, 2: {text}"]
    assert result.scenes[1]["fit"]["findings"][0]["kind"] == "arrangement"
    assert text in repr(result)
    good = pnp_sci.solve(scene.y, scene.masks, iterations=1)
    assert good.scene["fit"] == check_fit(scene.y, scene.masks).describe()
    assert pnp_sci.decode(scene.y, flipped, lambda problem, model: np.zeros(problem.op.shape)).remarks == [text]


def test_an_operator_may_be_given(scene):
    assert check_fit(scene.y, SensingOperator(scene.masks)).follows == check_fit(scene.y, scene.masks).follows


def test_benchmarks_and_real_captures_raise_no_alarm(data):
    scenes = [datasets.real(name) for name in datasets.REAL] + [datasets.real_dual(), datasets.singleview("traffic")]
    for scene in [*scenes, datasets.dualview("bear_blackswan")]:
        for y in scene.y.reshape(-1, *scene.y.shape[-2:]):
            assert check_fit(y, scene.masks).ok, scene.name


@pytest.mark.parametrize("unit", [1e-23, 1.0, 1e20])
def test_noise_is_compared_with_y_in_any_unit(scene, unit):
    """The squares of such values are beyond float32."""
    y = simulate(scene.truth, scene.masks, 0.01) * np.float32(unit)
    assert kinds(y, scene.masks, noise=0.01 * unit) == []
    assert kinds(y, scene.masks, noise=100 * unit) == ["noise"]


@pytest.mark.parametrize("bits", [1, 2])
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("noise", [0, 0.02])
def test_few_values_are_no_bad_pixels(bits, views, noise):
    scene = datasets.embedded_scene(128)
    y = np.maximum(simulate(scene.truth[:views], scene.masks[:views], noise), 0)
    y = np.round(y / y.max() * (2**bits - 1))
    fit = check_fit(y, scene.masks[:views])
    assert [finding.kind for finding in fit.findings] == ["coarse"]
    assert f"full_scale={2**bits - 1}, bits={bits})" in fit.findings[0].hint
    assert not fit.bad.any()
    assert check_fit(y, scene.masks[:views], noise=Sensor(full_scale=2**bits - 1, bits=bits)).ok


def test_uniform_light_has_as_few_values_as_the_masks():
    for frames in (1, 2, 3):
        masks = random_masks((1, frames, 64, 64))
        assert all(finding.kind != "coarse" for finding in check_fit(masks.sum((0, 1)) / 2, masks).findings)


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("axis", [0, 1])
def test_lines_swapped_in_pairs_are_named(make, axis):
    scene = datasets.embedded_scene(128)
    masks = make(scene.masks.shape, seed=1)
    y = simulate(scene.truth, masks, 0.01)
    fit = check_fit(np.take(y, np.arange(128) ^ 1, axis), masks)
    (finding,) = fit.findings
    assert finding.kind == "arrangement"
    assert f"{('rows', 'columns')[axis]} swapped in pairs" in finding.text
    assert fit.shift is None
    for step in (1, -1):
        assert kinds(np.roll(y, step, axis), masks) == ["shift"]
