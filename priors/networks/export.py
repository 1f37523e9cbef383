"""Export of the networks as ONNX: ``python -m priors.networks.export ffdnet --out ffdnet.onnx``; extra ``onnx``."""

from __future__ import annotations

import os
from pathlib import Path

import click
import torch

from priors.networks import files as _weights

NAMES = ("ffdnet", "video")
OWN = Path(__file__).parents[1] / "weights"


def export(name: str, out: Path, weights: Path | None = None) -> None:
    """Write the network of the prior `name` as an ONNX file, atomically.

    The inputs are `x`, frames, and `level`, the standard deviation of the noise of each pixel. Both are float32
    (N, H, W) with H and W multiples of 8. The output `noise` has the same shape, and ``x - noise`` is denoised.
    The network of "video" takes frames averaged along their motion, see
    :class:`priors.networks.along_motion.VideoNet`. The averages are not part of the model.

    Parameters
    ----------
    name : "ffdnet" or "video"
    out : Path
    weights : Path, optional
        Safetensors file; by default the weights of this package.

    Raises
    ------
    ImportError
        If onnx or onnxscript is not installed.
    pnp_sci.errors.DataUnavailableError, pnp_sci.errors.FormatError
        If the file of weights does not exist or cannot be used.
    """
    try:
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "ONNX needs onnx and onnxscript: python -m pip install '.[onnx]' in the folder of the sources"
        ) from error
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
@click.option("--weights", type=click.Path(path_type=Path), help="Weights to export.  [default: those of this package]")
def main(name: str, out: Path, weights: Path | None) -> None:
    """Write the network of the prior NAME as ONNX. Height and width of its inputs are multiples of 8."""
    export(name, out, weights)


if __name__ == "__main__":
    main()
