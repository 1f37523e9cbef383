"""Cases times priors: PSNR, SSIM, seconds and peak memory, each row in a process of its own."""

from .cases import expand, load
from .runner import Row, as_json, as_markdown, run

__all__ = ["Row", "as_json", "as_markdown", "expand", "load", "run"]
