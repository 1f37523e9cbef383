"""Stages of training: separator, flow net, refine net, and all together; and the baselines, in one stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ofanet_init import files as _weights
from ofanet_init.flow import COARSEST, enlarged
from ofanet_init.network import OFaNet
from ofanet_init.refine import Cell
from ofanet_init.train.card import write_card
from ofanet_init.train.motion import end_point_error, pairs, pyramid_loss
from ofanet_init.train.scenes import Batch, Scenes, batch, generator
from pnp_sci.accel.inference import mixed_precision
from pnp_sci.errors import InputError
from pnp_sci.masks import moving_masks
from pnp_sci.training.clips import Clip
from pnp_sci.training.task import Place, Progress

SIZE = 256  # pixels: side of the central square of a validation clip
ALPHA = 1.0  # weight of the separator's loss, as in the paper
EARLIER = 0.5  # weight of the loss of each earlier estimate of a baseline


@dataclass(frozen=True)
class Sample:
    """Samples of a step: `batch` measurements of `crop` x `crop` pixels, of which `window` frames are refined."""

    batch: int
    crop: int
    window: int


class Stage:
    """Base of the stages: data, model, and writing of the weights."""

    scores: tuple[str, ...]

    def __init__(
        self, model: Any, training: Sequence[Clip], validation: Sequence[Clip], sample: Sample, seed: int,
        place: Place, weights: Path, command: str,
    ):  # fmt: skip
        self.model, self.sample, self.seed = model, sample, seed
        self.training, self.validation = training, validation
        self.weights, self.command, self.settings = weights, command, str(model.config)
        self.scenes = Scenes(training, place.device)

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write weights and model card."""
        digest = _weights.save(self.weights, self.averaged(network))
        write_card(self, progress, place, digest)

    def state(self) -> dict[str, Any]:
        """Nothing: samples depend on seed, rank and step only."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Nothing is kept."""

    def averaged(self, network: torch.nn.Module) -> torch.nn.Module:
        """The whole model with the averaged weights of the part that this stage trains."""
        return network


class VideoStage(Stage):
    """Base of the stages that train a video from its measurement."""

    def made(self, place: Place, step: int) -> Batch:
        """The scenes, masks and measurements of a step."""
        config, size = self.model.config, self.sample.crop
        shape = (self.sample.batch, config.views, config.frames, size, size)
        return batch(self.scenes, self.seed, place.rank, step, shape)

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sums of the PSNR in dB of the last videos of the network, one for each score, and the number of videos.

        The views of a measurement are a held-out clip and the clips that follow it. Masks move as in the benchmark.
        """
        config = self.model.config
        total = torch.zeros(len(self.scores) + 1, dtype=torch.float64)
        masks = moving_masks((config.views, config.frames, SIZE, SIZE), seed=1).astype(np.float32)
        coded = torch.from_numpy(masks).to(place.device)
        clips = [c.frames[: config.frames] for c in self.validation if len(c.frames) >= config.frames]
        clips = [c[:, : c.shape[1] // 2 * 2, : c.shape[2] // 2 * 2] for c in clips if min(c.shape[1:]) >= SIZE]
        with torch.inference_mode(), mixed_precision(place.device):
            for n in range(place.rank, len(clips), place.world):
                views = [centre(clips[(n + v) % len(clips)]) for v in range(config.views)]
                truth = torch.from_numpy(np.stack(views)).to(place.device).float() / 255
                videos = network((coded * truth).sum((0, 1))[None], coded[None])
                for k, video in enumerate(videos[-len(self.scores) :]):
                    error = (video[0].float().clamp(0, 1) - truth).square().mean((2, 3)).clamp(min=1e-12)
                    total[k] -= 10 * error.log10().mean(1).sum().cpu()
                total[-1] += config.views
        return total


class Reconstruction(VideoStage):
    """Stages "dns", "refine" and "joint": the video from its measurement. Loss: ``alpha * L_DNS + L_refined``.

    The stage "refine" does not train the separator. Each step draws the number of passes, from 1 to that of the
    configuration.
    """

    scores = ("psnr_first", "psnr_refined")

    def __init__(self, name: str, *rest, **more):
        super().__init__(*rest, **more)
        self.name, self.network = name, self.model
        if name == "refine":
            self.model.separator.requires_grad_(False)
        cells = [module for module in self.model.modules() if isinstance(module, Cell)]
        self.compiled = [self.model.separator, *cells] + ([self.model.flow] if self.model.flow else [])

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Mean squared error of both videos for the scenes and masks of this step."""
        config, made = self.model.config, self.made(place, step)
        count = min(self.sample.window, config.frames)
        start = int(np.random.default_rng([self.seed, place.rank, step]).integers(config.frames - count + 1))
        passes = int(np.random.default_rng([self.seed, step]).integers(1, config.passes + 1))  # equal in all processes
        window = slice(start, start + count)
        with mixed_precision(place.device):
            first, refined = model(made.y, made.masks, window=window, passes=passes)
        coarse = (first.float() - made.truth).square().mean()
        if config.refine == "none":
            return coarse
        return ALPHA * coarse + (refined.float() - made.truth[:, :, window]).square().mean()


class Baseline(VideoStage):
    """A baseline, trained in one stage. Loss: that of the last estimate and half of those before it."""

    scores = ("psnr",)

    def __init__(self, *rest, **more):
        super().__init__(*rest, **more)
        self.name, self.network, self.compiled = self.model.model, self.model, [self.model]
        if self.sample.crop % self.model.multiple:
            expected = f"a multiple of {self.model.multiple} was expected for {self.name}"
            raise InputError(f"crop is {self.sample.crop}: {expected}")

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Mean squared errors for the scenes and masks of this step."""
        made = self.made(place, step)
        with mixed_precision(place.device):
            estimates = model(made.y, made.masks)
        *before, last = [(estimate.float() - made.truth).square().mean() for estimate in estimates]
        return last + EARLIER * sum(before)


class Flow(Stage):
    """Stage "flow": the flow net alone, on pairs of pictures with known motion."""

    name, scores = "flow", ("end_point_error", "of_no_motion")

    def __init__(self, *rest, **more):
        super().__init__(*rest, **more)
        if self.model.flow is None:
            raise InputError("stage is flow, but this configuration has no flow net: a refine net with flow is needed")
        self.model.flow.requires_grad_(True)  # `joint=False` freezes it in the later stages only
        if self.sample.crop % COARSEST:
            raise InputError(f"crop is {self.sample.crop}: a multiple of {COARSEST} was expected for the flow net")
        self.network, self.compiled = self.model.flow, [*self.model.flow.encoder, *self.model.flow.decoder]
        self.held_out = Scenes(self.validation, self.scenes.device) if self.validation else None

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Weighted sum over scales of the end-point error in pixels."""
        first, second, truth = self._pairs(self.scenes, 1 + step, place)
        with mixed_precision(place.device):
            flows = model(first, second)
        return pyramid_loss(flows, truth)

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """End-point error in pixels on held-out pairs, the error of zero flow, and the number of cases."""
        if self.held_out is None:
            return torch.zeros(3, dtype=torch.float64)
        first, second, truth = self._pairs(self.held_out, 0, place)
        with torch.inference_mode(), mixed_precision(place.device):
            flow = enlarged(network(first, second)[-1], 2)
        errors = [end_point_error(flow, truth), end_point_error(torch.zeros_like(truth), truth)]
        return torch.tensor([*(e.item() for e in errors), 1], dtype=torch.float64)

    def averaged(self, network: torch.nn.Module) -> OFaNet:
        """The initial model with the trained flow net."""
        assert self.model.flow is not None
        whole = OFaNet(self.model.config)
        whole.load_state_dict(self.model.state_dict())
        assert whole.flow is not None
        whole.flow.load_state_dict(network.state_dict())
        return whole

    def _pairs(self, scenes: Scenes, step: int, place: Place) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        random = generator(place.device, self.seed, place.rank, step)
        return pairs(scenes.crops(random, 2 * self.sample.batch, 1, self.sample.crop)[:, 0], random)


def centre(frames: np.ndarray) -> np.ndarray:
    """The central square (B, 256, 256) of frames (B, H, W)."""
    top, left = ((size - SIZE) // 2 for size in frames.shape[1:])
    return frames[:, top : top + SIZE, left : left + SIZE]
