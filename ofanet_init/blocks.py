"""Convolution blocks of the paper's Table 1."""

from __future__ import annotations

from torch import nn

from pnp_sci.accel.fusion import Residual

SLOPE = 0.1  # negative slope of the leaky ReLU; the paper gives no value


def activation() -> nn.Module:
    """The nonlinearity between layers: leaky ReLU."""
    return nn.LeakyReLU(SLOPE, inplace=True)


def convolution(inputs: int, outputs: int, kernel: int | tuple[int, int], stride: int = 1) -> nn.Conv2d:
    """A padded convolution: it keeps height and width, or divides them by the stride."""
    rows, columns = (kernel, kernel) if isinstance(kernel, int) else kernel
    layer = nn.Conv2d(inputs, outputs, (rows, columns), stride, (rows // 2, columns // 2))
    nn.init.kaiming_normal_(layer.weight, SLOPE)  # keeps the variance of the signal through many layers
    return layer


def chain(inputs: int, *layers: tuple[int | tuple[int, int], int], last: bool = True) -> nn.Sequential:
    """A sequence of convolutions (kernel, channels), each followed by an activation; the last one only if `last`."""
    modules: list[nn.Module] = []
    for kernel, channels in layers:
        modules += [convolution(inputs, channels, kernel), activation()]
        inputs = channels
    return nn.Sequential(*(modules if last else modules[:-1]))


def zero_initialised(layers: nn.Sequential) -> nn.Sequential:
    """Initialise the last layer with zeros, in place, so that what is added to something adds nothing at first."""
    for start in layers[-1].parameters():
        nn.init.zeros_(start)
    return layers


class ResidualUnit(Residual):
    """Residual unit ``x + conv3x3(conv1x1(conv3x3(x)))`` of the paper's Table 1."""

    def __init__(self, channels: int):
        super().__init__(zero_initialised(chain(channels, (3, channels), (1, channels), (3, channels), last=False)))


def residual_block(channels: int) -> nn.Sequential:
    """Three residual units: "cnn-resblock [3x3, 1x1, 3x3] x 3"."""
    return nn.Sequential(*(ResidualUnit(channels) for _ in range(3)))
