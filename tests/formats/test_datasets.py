import hashlib
import os
import shutil

import numpy as np
import pytest
import requests

from pnp_sci import datasets
from pnp_sci.errors import DataUnavailableError, FormatError, InputError
from pnp_sci.masks import condition

DATA = os.environ.get("PNP_SCI_DATA")
needs_data = pytest.mark.skipif(not DATA, reason="set PNP_SCI_DATA to the folder with the benchmark files")
NAME = "dualview/meas/bear_blackswan.mat"


@pytest.fixture
def offline(monkeypatch, tmp_path):
    """Neither data folder nor network, and an empty cache; returns the cache's folder."""
    import pooch

    def no_network(*_, **__):
        raise requests.ConnectionError("offline")

    monkeypatch.delenv("PNP_SCI_DATA", raising=False)
    monkeypatch.setattr(pooch, "os_cache", lambda _: tmp_path / "cache")
    monkeypatch.setattr(requests, "get", no_network)
    return tmp_path / "cache"


# ---- fetch ----------------------------------------------------------------------------------------------------------


def test_offline_says_what_to_do(offline):
    with pytest.raises(DataUnavailableError) as caught:
        datasets.fetch(NAME)
    for hint in (NAME, "PNP_SCI_DATA", "https://", str(offline / NAME)):
        assert hint in str(caught.value)
    assert not any(datasets.available().values())


def test_unknown_names(offline):
    with pytest.raises(InputError, match=r"name is 'nothing\.mat'.*dualview/256_simu_mask10\.mat"):
        datasets.fetch("nothing.mat")
    for load in (datasets.dualview, datasets.singleview, datasets.real):
        with pytest.raises(InputError, match="'nothing'"):
            load("nothing")


def test_a_wrong_file_in_the_folder_is_an_error(offline, monkeypatch, tmp_path):
    monkeypatch.setenv("PNP_SCI_DATA", str(tmp_path))
    wrong = tmp_path / NAME
    wrong.parent.mkdir(parents=True)
    wrong.write_bytes(b"something else")
    with pytest.raises(FormatError, match=r"bear_blackswan\.mat has SHA-256 .* was expected"):
        datasets.fetch(NAME)


def test_a_download_is_checked_and_kept(offline, monkeypatch):
    class Response:
        headers = {"content-length": "7"}  # noqa: RUF012
        raise_for_status = staticmethod(lambda: None)
        iter_content = staticmethod(lambda chunk_size: iter([b"content"]))

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        close = __exit__

    monkeypatch.setattr(requests, "get", lambda *_, **__: Response())
    with pytest.raises(FormatError, match=r"https://.* has not the SHA-256"):
        datasets.fetch(NAME)
    digest = hashlib.sha256(b"content").hexdigest()
    monkeypatch.setattr(datasets, "_registry", lambda: {NAME: (digest, "https://example.org/file.mat")})
    assert datasets.fetch(NAME).read_bytes() == b"content"
    assert datasets.available() == {NAME: True}
    monkeypatch.delattr(requests, "get")  # the second time, no download
    assert datasets.fetch(NAME) == offline / NAME


@needs_data
def test_a_cached_file_is_found(offline):
    cached = offline / NAME
    cached.parent.mkdir(parents=True)
    shutil.copy(f"{DATA}/{NAME}", cached)
    assert datasets.fetch(NAME) == cached
    assert datasets.available()[NAME]


def test_kobe_offline(offline):
    with pytest.raises(DataUnavailableError, match="PNP_SCI_DATA"):
        datasets.singleview("kobe")


# ---- benchmarks -----------------------------------------------------------------------------------------------------


@needs_data
@pytest.mark.parametrize("pair", ["bear_blackswan", "car-b_car-w", "hike_hockey"])
def test_dualview_measures_what_it_shows(pair):
    scene = datasets.dualview(pair)
    assert scene.truth is not None
    assert scene.truth.shape == scene.masks.shape == (2, 10, 256, 256)
    assert (scene.truth.dtype, scene.masks.dtype, scene.y.dtype) == (np.float32, np.uint8, np.float32)
    counts = np.rint(255 * scene.truth).astype(int)
    assert np.array_equal((counts * scene.masks).sum((0, 1)), np.rint(255 * scene.y).astype(int))
    assert 0 <= scene.truth.min() < scene.truth.max() <= scene.peak


@needs_data
def test_dualview_with_fewer_frames():
    whole, part = datasets.dualview("bear_blackswan"), datasets.dualview("bear_blackswan", frames=4)
    assert whole.truth is not None
    assert part.truth is not None
    assert np.array_equal(part.truth, whole.truth[:, :4])
    assert part.y == pytest.approx((part.truth * part.masks).sum((0, 1)), rel=1e-6)
    assert np.array_equal(datasets.dualview("bear_blackswan", frames=10).y, whole.y)
    for frames in (0, 11):
        with pytest.raises(InputError, match=f"frames is {frames}"):
            datasets.dualview("bear_blackswan", frames=frames)


@needs_data
def test_benchmark_masks_move_as_moving_masks_do():
    masks = datasets.dualview("bear_blackswan").masks
    for k in range(1, 10):
        assert np.array_equal(masks[0, k, k:, :-k], masks[0, 0, :-k, k:])
    assert np.array_equal(masks[1, 0, 15:, :-18], masks[0, 0, :-15, 18:])
    report = condition(masks)
    assert np.multiply(report.closed, 256**2) == pytest.approx([98, 77])
    assert report.closed_in_all == 0


@needs_data
@pytest.mark.parametrize(("name", "count"), [("runner", 5), ("traffic", 6), ("kobe", 1)])
def test_singleview_measures_what_it_shows(name, count):
    scene = datasets.singleview(name)
    assert scene.truth is not None
    assert scene.truth.shape == (count, 1, 8, 256, 256)
    assert scene.masks.shape == (1, 8, 256, 256)
    assert scene.y == pytest.approx((scene.truth * scene.masks).sum((1, 2)), abs=1e-5)


@needs_data
@pytest.mark.parametrize("name", ["wheel", "hand"])
def test_real_captures(name):
    scene = datasets.real(name)
    assert scene.masks.shape == (1, 14, 256, 256)
    assert (scene.masks.min(), scene.masks.max()) == (0, 1)
    counts = scene.y.astype(float) * 255 / 1000
    assert counts == pytest.approx(np.rint(counts), abs=1e-4)
    assert scene.truth is None


@needs_data
def test_real_dual_is_the_sum_of_two_captures():
    both, wheel, hand = datasets.real_dual(), datasets.real("wheel"), datasets.real("hand")
    assert np.array_equal(both.y, wheel.y[:-16, :-16] + hand.y[16:, 16:])
    assert np.array_equal(both.masks[1], hand.masks[0, :, 16:, 16:])
    report = condition(both.masks)
    assert report.separable
    assert report.view_correlation < 0.05
    assert "2 views x 14 frames of 240 x 240, without truth" in repr(both)


# ---- the scene that is always there ---------------------------------------------------------------------------------


def test_embedded_scene_is_there_offline_and_deterministic(offline):
    scene, again = datasets.embedded_scene(64), datasets.embedded_scene(64)
    assert scene.truth is not None
    assert again.truth is not None
    assert scene.truth.shape == scene.masks.shape == (2, 10, 64, 64)
    assert scene.truth.dtype == scene.y.dtype == np.float32
    assert np.array_equal(scene.truth, again.truth)
    assert np.array_equal(scene.y, again.y)
    assert scene.y == pytest.approx((scene.truth * scene.masks).sum((0, 1)), rel=1e-5)
    assert scene.truth.min() >= 0
    assert scene.truth.max() <= 1


def test_embedded_scene_moves_by_a_pixel_or_two():
    """In each view the background pans with a sub-pixel step, and the object moves against it."""
    from skimage.registration import phase_cross_correlation

    truth = datasets.embedded_scene(128).truth
    assert truth is not None
    for view in truth:
        corner = slice(0, 40)  # without the object
        step = phase_cross_correlation(view[0][corner], view[1][corner], upsample_factor=20)[0]
        assert 0.5 <= np.hypot(*step) <= 2
        centre = slice(54, 74)
        object_step = phase_cross_correlation(view[4][centre, centre], view[5][centre, centre], upsample_factor=20)[0]
        assert np.hypot(*(object_step - step)) > 1


def test_embedded_scene_can_be_small_but_not_tiny():
    assert datasets.embedded_scene(16).y.shape == (16, 16)
    with pytest.raises(InputError, match="size is 8"):
        datasets.embedded_scene(8)
