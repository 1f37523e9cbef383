"""BIRNAT: the first frame from the measurement, then a recurrent network forwards, then one backwards."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from ofanet_init.amplifier import normalised
from ofanet_init.baselines.config import BaselineConfig
from ofanet_init.blocks import activation, chain, convolution, residual_block, zero_initialised

WIDTH = 64  # channels of the network for the first frames, at half resolution
HIDDEN, SEEN, BEFORE = 20, 10, 20  # features at half resolution: hidden state, measurement, frames before
STATE = HIDDEN + SEEN + BEFORE
POOL = 8  # features: height and width of the cells whose means are the keys of the attention


class BIRNAT(nn.Module):
    """Bidirectional recurrent network with attention.

    A residual network with attention reconstructs the first frames. The forward network then goes from frame to frame:
    it has the frame before, its hidden state, and what the measurement leaves for this frame, if the mean of all frames
    stands for those that follow. The backward network goes back over the frames with the hidden state of the forward
    one.

    It differs from the published network in these points. The frames of all views at one time are one step. The
    recurrent networks work at half resolution and have one block of three residual units instead of two. A step also
    has the masks of its frames, because masks vary between measurements, and what stands for its frames so far. It
    returns a correction to the frame before. On the way back, the forward estimates stand for frames to come, and a
    step corrects that of its own frame. The first frames are a correction to the normalised measurement. The keys of
    the attention are means over 8 x 8 features. The network for the first frames has 64 channels instead of 128. There
    is no adversarial loss.

    References
    ----------
    Z. Cheng et al., "BIRNAT: bidirectional recurrent neural networks with adversarial training for video snapshot
    compressive imaging", ECCV 2020; released code: github.com/BoChenGroup/BIRNAT.
    """

    model, title = "birnat", "BIRNAT"
    multiple = 2

    def __init__(self, config: BaselineConfig):
        super().__init__()
        self.config = config
        self.first = FirstFrames(config)
        self.forwards, self.backwards = Recurrence(config.views), Recurrence(config.views)

    def forward(self, y: torch.Tensor, masks: torch.Tensor) -> list[torch.Tensor]:
        """Decode y (N, H, W) through masks (N, V, B, H, W); returns two videos (N, V, B, H, W), the better one last."""
        common = normalised(y, masks)
        first = self.first(common, masks)
        guess = common[:, None].expand_as(masks)
        hidden = y.new_zeros(len(y), HIDDEN, *(size // 2 for size in y.shape[1:]))
        frames = range(masks.shape[2])
        onward, hidden = self.forwards(y, masks, guess, first, hidden, frames[1:], follow=True)
        return [onward, self.backwards(y, masks, onward, onward[:, :, -1], hidden, frames[-2::-1], follow=False)[0]]


class FirstFrames(nn.Module):
    """The first frame of each view: convolutions, residual blocks at half resolution, and attention."""

    def __init__(self, config: BaselineConfig):
        super().__init__()
        self.down = nn.Sequential(
            chain(1 + config.planes, (5, 32), (3, 64), (1, 64)), convolution(64, WIDTH, 3, stride=2), activation()
        )
        between = ((3, WIDTH), (1, WIDTH))
        self.blocks = nn.Sequential(
            residual_block(WIDTH), chain(WIDTH, *between), residual_block(WIDTH), chain(WIDTH, *between),
            residual_block(WIDTH),
        )  # fmt: skip
        self.attention = Attention(WIDTH)
        self.up = nn.Sequential(
            nn.ConvTranspose2d(WIDTH, 64, 3, stride=2, padding=1, output_padding=1),
            activation(),
            chain(64, (3, 32), (1, 16), (3, config.views), last=False),
        )

    def forward(self, common: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """First frames (N, V, H, W) from the normalised measurement (N, 1, H, W) and masks (N, V, B, H, W)."""
        h = self.blocks(self.down(torch.cat([common, (common[:, None] * masks).flatten(1, 2)], 1)))
        return common + self.up(self.attention(h)).float()


class Attention(nn.Module):
    """Self-attention ``x + scale * W softmax(q k) v`` over the pixels, with keys and values of cells."""

    def __init__(self, width: int):
        super().__init__()
        self.query, self.key = convolution(width, width // 8, 1), convolution(width, width // 8, 1)
        self.value, self.out = convolution(width, width, 1), convolution(width, width, 1)
        self.scale = nn.Parameter(torch.zeros(()))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, width, H, W) -> (N, width, H, W)."""
        cells = functional.avg_pool2d(x, POOL, ceil_mode=True)
        given = (self.query(x), self.key(cells), self.value(cells))
        query, key, value = (part.flatten(2).transpose(1, 2)[:, None].contiguous() for part in given)
        # torch has no kernel without the whole matrix of scores unless all have equally many channels
        query, key = (functional.pad(part, (0, value.shape[-1] - part.shape[-1])) for part in (query, key))
        found = functional.scaled_dot_product_attention(query, key, value, scale=1.0)[:, 0]
        return x + self.scale * self.out(found.transpose(1, 2).unflatten(2, x.shape[2:]))


class Recurrence(nn.Module):
    """A recurrent network that goes from frame to frame in one direction."""

    def __init__(self, views: int):
        super().__init__()
        self.see = nn.Sequential(
            convolution(2 + 2 * views, 20, 5, stride=2), activation(), chain(20, (1, 20), (3, 40), (1, 40), (3, SEEN))
        )
        self.before = nn.Sequential(
            convolution(2 * views, 20, 5, stride=2), activation(), chain(20, (1, 20), (3, 40), (1, 40), (3, BEFORE))
        )
        self.blocks = residual_block(STATE)
        self.keep = chain(STATE, (3, 30), (1, 20), (3, HIDDEN))
        self.up = nn.Sequential(
            chain(STATE, (3, 40), (1, 30)),
            nn.ConvTranspose2d(30, 20, 2, 2),
            activation(),
            zero_initialised(chain(20, (3, 20), (1, views), last=False)),
        )

    def forward(
        self, y: torch.Tensor, masks: torch.Tensor, guess: torch.Tensor, last: torch.Tensor, hidden: torch.Tensor,
        order: range, follow: bool,
    ) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
        """Frames of `order`, one after the other, after the frames `last` (N, V, H, W) that precede them.

        guess: video (N, V, B, H, W) that stands for frames not yet reconstructed. If `follow`, a step corrects the
        frame before, else the guess of its own frame. Returns the video, and the last hidden state.
        """
        common = normalised(y, masks)
        t = order.start - order.step
        video = {t: last}
        left = y - (masks * guess).sum((1, 2)) + (masks[:, :, t] * (guess[:, :, t] - last)).sum(1)
        for t in order:
            own, guessed = masks[:, :, t], guess[:, :, t]
            here = left + (own * guessed).sum(1)  # what the measurement leaves for the frames of this time
            evidence = torch.cat([common, here[:, None], own, own * here[:, None]], 1)
            state = torch.cat([hidden, self.see(evidence), self.before(torch.cat([last, guessed], 1))], 1)
            state = self.blocks(state)
            hidden = self.keep(state)
            last = (last if follow else guessed) + self.up(state).float()
            video[t] = last
            left = here - (own * last).sum(1)
        return torch.stack([video[t] for t in sorted(video)], 2), hidden
