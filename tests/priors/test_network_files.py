"""Files of weights of the networks, and when they are read."""

import subprocess
import sys

import pytest

from pnp_sci.errors import DataUnavailableError, FormatError, InputError
from priors.networks.along_motion import VideoNet
from priors.networks.image import WEIGHTS, ImageNet

torch = pytest.importorskip("torch")
save_file = pytest.importorskip("safetensors.torch").save_file
unet = pytest.importorskip("priors.networks.unet")
files = pytest.importorskip("priors.networks.files")
weights_files = pytest.importorskip("pnp_sci.formats.weights")


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A folder with weights of either network, as they are before training."""
    folder = tmp_path_factory.mktemp("weights")
    torch.manual_seed(0)
    for name in ("ffdnet", "video"):
        files.save(folder / name, name, unet.SMALL, unet.Network(unet.SMALL))
    return folder


@pytest.mark.parametrize("device", ["abacus", "meta", "privateuseone", "cuda:99"])
def test_devices_that_cannot_compute(weights, device):
    """Some are unknown; "meta" has tensors without values."""
    with pytest.raises(InputError, match=f"device: '{device}'"):
        ImageNet(weights / "ffdnet", device=device)


TOO_MANY = '{"widths": [1, 1], "blocks": [3000000, 1]}'


@pytest.mark.parametrize("architecture", [
    "[]", "{}", "null", "7", "not JSON", "[" * 100_000, '{"widths": [-1], "blocks": [1]}',
    '{"widths": [], "blocks": []}', '{"widths": 8, "blocks": 1}', '{"widths": ["a"], "blocks": [1]}', TOO_MANY,
    '{"widths": [1000000], "blocks": [1]}', '{"widths": [1, 1], "blocks": [1]}', '{"widths": [1], "depths": [1]}',
])  # fmt: skip
def test_an_architecture_that_cannot_be(architecture, tmp_path):
    """Refused before a network is made of it, which might take hours."""
    tensors = {"a": torch.zeros(1).half()}
    found = {"prior": "ffdnet", "architecture": architecture, "sha256": weights_files.fingerprint(tensors)}
    save_file(tensors, tmp_path / "w", found)
    with pytest.raises(FormatError):
        files.load(tmp_path / "w", "ffdnet")


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.int8, torch.complex64, torch.bool])
def test_values_of_another_type(kind, tmp_path):
    save_file({"a": torch.zeros(1).to(kind)}, tmp_path / "w", {"prior": "ffdnet", "architecture": "{}", "sha256": ""})
    with pytest.raises(FormatError, match="float16"):
        files.load(tmp_path / "w", "ffdnet")


def test_weights_are_read_once_and_again_when_the_file_has_changed(weights, tmp_path):
    path = tmp_path / "ffdnet"
    path.write_bytes((weights / "ffdnet").read_bytes())
    first = ImageNet(path)
    assert ImageNet(path).runner is first.runner
    torch.manual_seed(1)
    other = unet.Network(unet.SMALL)
    digest = files.save(path, "ffdnet", unet.SMALL, other)
    assert ImageNet(path).hashes == [digest] != first.hashes


def test_the_hashes_of_the_video_net_are_those_of_its_networks(weights):
    known = [
        files.load(path, name)[1]
        for path, name in ((weights / "video", "video"), (WEIGHTS / "ffdnet.safetensors", "ffdnet"))
    ]
    assert VideoNet(weights / "video").hashes == known


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_shipped_weights_have_a_card_with_their_hash(name):
    digest = files.load(WEIGHTS / f"{name}.safetensors", name)[1]
    assert digest in (WEIGHTS / f"{name}.md").read_text()


def test_weights_survive_the_file(weights, tmp_path):
    network, digest = files.load(weights / "video", "video")
    assert files.save(tmp_path / "again", "video", network.architecture, network) == digest
    assert ImageNet(weights / "ffdnet").hashes[0] == files.load(weights / "ffdnet", "ffdnet")[1]
    assert not list(tmp_path.glob("*.partial"))


def test_weights_that_do_not_fit(weights, tmp_path):
    with pytest.raises(DataUnavailableError, match=r"python -m priors\.train video"):
        files.load(tmp_path / "none", "video")
    with pytest.raises(FormatError, match="holds ffdnet, but video was expected"):
        files.load(weights / "ffdnet", "video")
    (tmp_path / "text").write_text("not weights at all")
    with pytest.raises(FormatError, match="not a safetensors file"):
        files.load(tmp_path / "text", "video")
    save_file({"a": torch.zeros(1)}, tmp_path / "foreign")
    with pytest.raises(FormatError, match="no prior of this package"):
        files.load(tmp_path / "foreign", "video")
    damaged = bytearray((weights / "video").read_bytes())
    damaged[-1] ^= 1
    (tmp_path / "damaged").write_bytes(damaged)
    with pytest.raises(FormatError, match="damaged"):
        files.load(tmp_path / "damaged", "video")
    files.save(tmp_path / "misfit", "video", unet.Architecture((8, 8), (1, 1)), unet.Network(unet.SMALL))
    with pytest.raises(FormatError, match="do not fit"):
        files.load(tmp_path / "misfit", "video")


def test_torch_is_loaded_when_a_session_begins():
    """And not with the priors, nor with what they say of themselves."""
    code = (
        "import sys, numpy as np; from priors.ffdnet import FFDNet;"
        "from priors.video import Video; made = [FFDNet(), Video()];"
        "[prior.traits((2, 4, 40, 40)) for prior in made]; assert 'torch' not in sys.modules;"
        "FFDNet().begin((1, 1, 8, 8), np.dtype('f4')); assert 'torch' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_says_what_to_install_without_torch(weights, monkeypatch):
    monkeypatch.setitem(sys.modules, "priors.networks.runner", None)
    with pytest.raises(ImportError, match=r"\.\[learned\]"):
        ImageNet(weights / "ffdnet")
