"""The networks as ONNX do what they do here."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnxscript")
onnxruntime = pytest.importorskip("onnxruntime")
testing = pytest.importorskip("click.testing")
export = pytest.importorskip("priors.networks.export")
_weights = pytest.importorskip("priors.networks.files")


@pytest.mark.parametrize("name", export.NAMES)
def test_the_same_noise_for_any_number_and_size_of_frames(name, tmp_path):
    out = tmp_path / "net.onnx"
    result = testing.CliRunner().invoke(export.main, [name, "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    session = onnxruntime.InferenceSession(out)
    network, digest = _weights.load(export.OWN / f"{name}.safetensors", name)
    assert session.get_modelmeta().custom_metadata_map["sha256"] == digest
    for shape in ((1, 8, 8), (3, 40, 64)):
        x = np.random.default_rng(0).random(shape, np.float32)
        level = np.linspace(0.01, 0.2, x.size, dtype=np.float32).reshape(shape)
        (noise,) = session.run(None, {"x": x, "level": level})
        with torch.no_grad():
            expected = network(torch.from_numpy(x), torch.from_numpy(level)).numpy()
        np.testing.assert_allclose(noise, expected, atol=1e-5)
    assert not list(tmp_path.glob("*.partial*"))
