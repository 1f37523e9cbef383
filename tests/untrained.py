"""OFaNet as it is before training, and measurements for it: ``from untrained import make, measured``."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
config = pytest.importorskip("ofanet_init.config")
network = pytest.importorskip("ofanet_init.network")


def make(**fields):
    """An untrained model whose layers all do something."""
    torch.manual_seed(0)
    model = network.OFaNet(config.OFaNetConfig(**{"frames": 4} | fields))
    for layer in (*(model.flow.predict if model.flow else ()), *(net.cell.r[-1] for net in model.refiners)):
        torch.nn.init.normal_(layer.weight, std=0.1)
    return model.eval()


def measured(views=2, frames=4, rows=20, columns=26, seed=0):
    random = np.random.default_rng(seed)
    masks = torch.from_numpy((random.random((1, views, frames, rows, columns)) < 0.5).astype(np.float32))
    truth = torch.from_numpy(random.random((1, views, frames, rows, columns), np.float32))
    return (masks * truth).sum((1, 2)), masks
