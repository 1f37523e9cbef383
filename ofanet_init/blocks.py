"""The convolution blocks that the paper's table of layers is made of."""

from __future__ import annotations

from torch import nn

from pnp_sci.accel.fusion import Residual

SLOPE = 0.1  # of the leaky rectifier between layers; the paper names none


def activation() -> nn.Module:
    """The nonlinearity between layers."""
    return nn.LeakyReLU(SLOPE, inplace=True)


def convolution(inputs: int, outputs: int, kernel: int | tuple[int, int], stride: int = 1) -> nn.Conv2d:
    """A convolution that keeps the size of its input, or divides it by its stride."""
    rows, columns = (kernel, kernel) if isinstance(kernel, int) else kernel
    layer = nn.Conv2d(inputs, outputs, (rows, columns), stride, (rows // 2, columns // 2))
    nn.init.kaiming_normal_(layer.weight, SLOPE)  # torch's own start lets the signal fade over so many layers
    return layer


def chain(inputs: int, *layers: tuple[int | tuple[int, int], int], last: bool = True) -> nn.Sequential:
    """Convolutions of (kernel, channels) one after the other, an activation behind each; behind the last if `last`."""
    modules: list[nn.Module] = []
    for kernel, channels in layers:
        modules += [convolution(inputs, channels, kernel), activation()]
        inputs = channels
    return nn.Sequential(*(modules if last else modules[:-1]))


class ResidualUnit(Residual):
    """``x + conv3x3(conv1x1(conv3x3(x)))``, the bracket in the paper's table."""

    def __init__(self, channels: int):
        super().__init__(chain(channels, (3, channels), (1, channels), (3, channels), last=False))
        nn.init.zeros_(self.body[-1].weight)  # type: ignore[arg-type]  # it starts as the identity


def residual_block(channels: int) -> nn.Sequential:
    """Three residual units: "cnn-resblock [3x3, 1x1, 3x3] x 3"."""
    return nn.Sequential(*(ResidualUnit(channels) for _ in range(3)))
