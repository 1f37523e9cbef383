"""Classification of scenes as still or moving, on validation clips and on still copies of their first frame.

For each kind of scene the output is the number of still scenes that are found, and of still views beside moving ones.
For moving scenes that are classified as still, wholly or in a view, it is the change of PSNR in dB from the full model.

PNP_SCI_DATA=DIR python benchmarks/still_or_moving.py
PNP_SCI_DATA=DIR python benchmarks/still_or_moving.py mirrored    # the cases of parts.py, in four orientations
"""

import itertools
import os
import sys
from pathlib import Path

import numpy as np
import parts

import pnp_sci
from pnp_sci import SceneModel
from pnp_sci.training.clips import load_clips, split

KINDS = (  # views, frames, pixels per side, density of the masks, noise of max(y), brightness of the last view
    (2, 10, 256, 0.5, 0), (1, 8, 256, 0.5, 0), (2, 10, 128, 0.5, 0), (1, 8, 128, 0.5, 0), (2, 10, 128, 0.1, 0),
    (1, 24, 128, 0.5, 0), (2, 20, 128, 0.5, 0), (3, 10, 128, 0.5, 0), (2, 10, 64, 0.5, 0), (2, 10, 128, 0.5, 0.01),
    (1, 8, 128, 0.5, 0.02), (2, 10, 256, 0.5, 0.03), (2, 10, 128, 0.5, 0, 0.3), (2, 10, 128, 0.5, 0, 0.1),
)  # fmt: skip
PRIORS = ("tv", "flow")


def scenes(clips, views, frames, size):
    """Truths (V, B, H, W): the central squares of a clip and of the next ones."""
    long = [clip.frames for clip in clips if len(clip.frames) >= frames and min(clip.frames.shape[1:]) >= size]
    for n in range(len(long)):
        parts = (long[(n + v) % len(long)][:frames] for v in range(views))
        corners = ((p, (p.shape[1] - size) // 2, (p.shape[2] - size) // 2) for p in parts)
        yield np.stack([p[:, t : t + size, l : l + size] for p, t, l in corners]).astype(np.float32) / 255


def still(y, masks, prior):
    """Whether the scene is classified as still, or which of its views are."""
    return pnp_sci.solve(y, masks, prior, iterations=1).scene["still"]


def gain(y, masks, prior, taken, truth):
    """Change of PSNR in dB if frames of views are tied that are `taken` for still."""
    models = ("full", SceneModel((True,) * len(truth), taken))
    results = [pnp_sci.solve(y, masks, prior, scene=model) for model in models]
    return float(np.diff([np.mean(pnp_sci.psnr(r.x, truth)) for r in results])[0])


def mirrored():
    """Frozen cases of parts.py that are found, and moving ones that are taken for still, by the prior `video`."""
    clips = parts.validation_clips()
    found, gains, count = 0, [], 0
    for truth, masks, y in itertools.chain(parts.cases(clips, parts.QUIET), parts.cases(clips, parts.QUIET, first=100)):
        frozen = np.repeat(truth[:, :1], truth.shape[1], axis=1)
        found += still(pnp_sci.simulate(frozen, masks), masks, "video") is True
        for down, right in itertools.product((1, -1), repeat=2):
            seen, coded, moving = (np.ascontiguousarray(a[..., ::down, ::right]) for a in (y, masks, truth))
            if taken := still(seen, coded, "video"):
                gains.append(gain(seen, coded, "video", taken, moving))
        count += 1
    wrong = ", ".join(f"{g:+.1f}" for g in sorted(gains)) or "none"
    print(f"{found} of {count} frozen scenes found, of {4 * count} moving ones classified as still: {wrong}")


def main():
    _, clips = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    for views, frames, size, density, noise, *dim in KINDS:
        masks = pnp_sci.random_masks((views, frames, size, size), density, seed=1)
        truths = list(scenes(clips, views, frames, size))
        for truth in truths:
            truth[-1] *= dim[0] if dim else 1
        report = []
        for prior in PRIORS:
            found, beside, gains = 0, 0, []
            for truth in truths:
                frozen = np.repeat(truth[:, :1], frames, axis=1)
                found += still(pnp_sci.simulate(frozen, masks, noise=noise), masks, prior) is True
                if views > 1:
                    one = np.concatenate([frozen[:1], truth[1:]])
                    only_first = (True, *[False] * (views - 1))
                    beside += still(pnp_sci.simulate(one, masks, noise=noise), masks, prior) == only_first
                y = pnp_sci.simulate(truth, masks, noise=noise)
                if taken := still(y, masks, prior):
                    gains.append(gain(y, masks, prior, taken, truth))
            wrong = ", ".join(f"{gain:+.1f}" for gain in sorted(gains)) or "none"
            ones = f", {beside} still views" if views > 1 else ""
            report.append(f"{prior}: {found}{ones} of {len(truths)} found, moving ones classified as still: {wrong}")
        last = f", last view {dim[0]}" if dim else ""
        print(f"{views} x {frames}, {size}, {density}, {noise}{last}: {'; '.join(report)}", flush=True)


if __name__ == "__main__":
    mirrored() if "mirrored" in sys.argv else main()
