"""The networks for other software: ``python -m priors.export ffdnet --out ffdnet.onnx``. Needs the extra ``onnx``."""

from __future__ import annotations

import os
from pathlib import Path

import click
import torch

from priors.networks import files as _weights

NAMES = ("ffdnet", "video")
OWN = Path(__file__).parents[1] / "weights"


def export(name: str, out: Path, weights: Path | None = None) -> None:
    """Write the network of the prior `name` as ONNX, at once or not at all.

    The model has inputs `x` and `level`, frames and the standard deviation of the noise in each of their pixels, both
    float32 (N, H, W) with H and W multiples of 8, and the output `noise` of the same shape; ``x - noise`` is denoised.
    The network of "video" works on frames that have been averaged along their motion, see
    :class:`priors.video.VideoDenoiser`; the averages are not part of the model.

    Parameters
    ----------
    name : "ffdnet" or "video"
    out : Path
    weights : Path, optional
        Safetensors file; by default the weights of this package.

    Raises
    ------
    pnp_sci.errors.DataUnavailableError, pnp_sci.errors.FormatError
        If there are no such weights, or they cannot be used.
    """
    try:
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise ImportError("ONNX needs onnx and onnxscript: pip install 'pnp-sci[onnx]'") from error
    out.parent.mkdir(parents=True, exist_ok=True)
    network, digest = _weights.load(weights or OWN / f"{name}.safetensors", name)
    size = 2 * network.architecture.multiple
    x = torch.rand(2, size, size)
    any_size = dict.fromkeys(range(3), torch.export.Dim.AUTO)
    program = torch.onnx.export(
        network,
        (x, torch.full_like(x, 0.1)),
        dynamo=True,
        verbose=False,
        dynamic_shapes={"x": any_size, "level": any_size},
        input_names=["x", "level"],
        output_names=["noise"],
    )
    assert program is not None
    program.model.metadata_props.update(prior=name, sha256=digest)
    partial = out.with_name(out.name + ".partial")
    program.save(partial)
    os.replace(partial, out)


@click.command()
@click.argument("name", type=click.Choice(NAMES))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), required=True, help="File to write.")
@click.option("--weights", type=click.Path(path_type=Path), help="Weights of your own.  [default: this package's]")
def main(name: str, out: Path, weights: Path | None) -> None:
    """Write the network of the prior NAME as ONNX, for H and W that are multiples of 8."""
    export(name, out, weights)


if __name__ == "__main__":
    main()
