"""Results of the OFaNet paper, as printed there.

R. Lu, B. Chen, G. Liu, Z. Cheng, M. Qiao and X. Yuan, "Dual-view Snapshot Compressive Imaging via Optical Flow Aided
Recurrent Neural Network", 2021, arXiv:2109.05287. Tables are numbered in the order of the arXiv source, where Table 1
is the network's architecture.

PSNR is in dB, seconds are per measurement. "The experiments are conducted on a NVIDIA RTX 8000 GPU"; the paper does not
name the hardware of GAP-TV, PnP-TV-FFD and DeSCI. Videos have the names of this project: the pair ``bear_blackswan``
has the rows ``bear`` and ``blackswan``. ADMM-net, which two tables call ADMMnet, has one name.

Inconsistent numbers of the paper are unchanged:

- Averages that are not the mean of their column: PnP-TV-FFD 22.54 dB (mean 22.45, Table 2); in Table 6 U-net 29.26 dB
  (29.60) and GAP-TV 0.858 (0.851).
- ADMM-net at B = 10 takes 0.0629 s in Table 2 and 0.0680 s in Table 4.
- OFaNet is printed in bold as the best of every row of Tables 2 and 4, but DeSCI has larger values on ``bike`` and
  ``bus`` (PSNR and SSIM) and at B = 6 (SSIM).

Examples
--------
>>> DUAL_VIEW.values["bear"]["OFaNet"]
Score(psnr=25.4, ssim=0.64, seconds=None)
>>> [DUAL_VIEW.values[video]["GAP-TV"].psnr for video in "bear_blackswan".split("_")]
[22.82, 22.5]
>>> DUAL_VIEW.values[AVERAGE]["DeSCI"].seconds, FRAMES.values[14]["OFaNet"].psnr, NOISE.values[0.05]["OFaNet"].psnr
(21600.4, 24.25, 20.69)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

AVERAGE = "average"


class Score(NamedTuple):
    """One cell: PSNR in dB, SSIM, and seconds per measurement if the paper has them."""

    psnr: float
    ssim: float
    seconds: float | None = None


@dataclass(frozen=True)
class Table:
    """A table of the paper.

    Attributes
    ----------
    title : str
    source : str
        Number of the table in the paper.
    values : dict
        ``values[row][method]``, both in the paper's order. A row is a video, ``AVERAGE``, a number of frames, or a
        standard deviation of noise.
    """

    title: str
    source: str
    values: dict[str | float, dict[str, Score]]

    @property
    def rows(self) -> tuple[str | float, ...]:
        """The rows: videos and ``AVERAGE``, numbers of frames, or standard deviations of noise."""
        return tuple(self.values)

    @property
    def columns(self) -> tuple[str, ...]:
        """The methods."""
        return tuple(next(iter(self.values.values())))


def _values(methods: str, text: str) -> dict[str | float, dict[str, Score]]:
    """Parse a table: lines of a name, then PSNR and SSIM of each method; ``seconds`` belongs to the line above it."""
    columns = methods.split(", ")
    values: dict[str | float, dict[str, Score]] = {}
    row: str | float = ""
    for name, *cells in map(str.split, text.strip().splitlines()):
        numbers = [float(cell) for cell in cells]
        if name == "seconds":
            scores = [score._replace(seconds=time) for score, time in zip(values[row].values(), numbers, strict=True)]
        else:
            row = float(name) if name[0].isdigit() else name
            scores = [Score(psnr, ssim) for psnr, ssim in zip(numbers[::2], numbers[1::2], strict=True)]
        values[row] = dict(zip(columns, scores, strict=True))
    return values


DUAL_VIEW = Table(
    "Dual view, B = 10, no noise",
    "Table 2",
    _values(
        "GAP-TV, PnP-TV-FFD, DeSCI, U-net, ADMM-net, BIRNAT, OFaNet",
        """
        bear       22.82 0.58  23.01 0.58  24.33 0.60  23.70 0.56  24.91 0.60  24.61 0.60  25.40 0.64
        blackswan  22.50 0.58  23.71 0.58  24.10 0.58  24.11 0.53  24.69 0.57  24.42 0.56  25.76 0.65
        boy        23.75 0.56  24.00 0.56  25.58 0.56  24.48 0.51  25.79 0.54  25.69 0.54  26.12 0.57
        girl       22.07 0.61  22.28 0.61  24.41 0.64  22.61 0.53  24.02 0.60  23.96 0.60  25.70 0.68
        car-b      20.75 0.61  21.11 0.62  21.93 0.65  21.06 0.57  22.08 0.63  22.00 0.64  23.15 0.69
        car-w      21.31 0.64  21.65 0.64  22.74 0.72  21.63 0.59  22.41 0.65  22.23 0.66  23.73 0.74
        bike       24.38 0.67  22.00 0.56  26.65 0.74  23.47 0.57  25.23 0.64  25.06 0.67  26.30 0.71
        bus        22.31 0.72  21.86 0.66  28.20 0.83  22.25 0.65  23.72 0.71  23.55 0.73  25.43 0.79
        cow        21.63 0.52  21.49 0.48  22.45 0.53  21.91 0.47  22.94 0.53  22.65 0.53  23.15 0.55
        dog        23.69 0.58  23.93 0.51  24.43 0.53  24.55 0.51  25.23 0.54  24.88 0.54  25.94 0.60
        hike       21.90 0.51  21.48 0.47  23.28 0.57  22.12 0.45  23.46 0.53  23.15 0.53  23.85 0.57
        hockey     22.75 0.67  22.89 0.61  26.04 0.78  23.72 0.62  25.14 0.69  24.93 0.72  26.85 0.79
        average    22.49 0.60  22.54 0.57  24.51 0.64  22.97 0.55  24.14 0.60  23.93 0.61  25.12 0.67
        seconds    16.9        52.3        21600.4     0.0216      0.0629      0.5132      0.4893
        """,
    ),
)

# Without diversity amplifier, dual-net separator, refine net, optical flow, backward flow, joint training of the flow.
# In the source, the SSIM of w/o DA on boy is "0.5 5".
ABLATION = Table(
    "Variants of OFaNet, dual view, B = 10, no noise",
    "Table 3",
    _values(
        "w/o DA, w/o DNS, w/o RN, w/o OF, w/o Br, w/o JT, DA&DNS&BRRN, OFaNet",
        """
        bear      24.86 0.60  25.10 0.61  24.61 0.58  24.70 0.60  25.01 0.61  25.20 0.63  25.27 0.64  25.40 0.64
        blackswan 24.97 0.60  25.38 0.62  24.57 0.56  25.03 0.60  25.23 0.61  25.48 0.62  25.61 0.64  25.76 0.65
        boy       25.92 0.55  25.99 0.56  25.59 0.53  25.75 0.55  25.87 0.55  25.98 0.56  26.06 0.56  26.12 0.57
        girl      24.80 0.64  24.96 0.65  23.95 0.60  25.27 0.66  25.36 0.67  25.53 0.67  25.61 0.68  25.70 0.68
        car-b     22.40 0.65  22.67 0.66  21.79 0.61  22.18 0.64  22.54 0.65  22.79 0.67  23.02 0.68  23.15 0.69
        car-w     22.94 0.69  23.25 0.71  22.40 0.67  23.05 0.70  23.39 0.72  23.49 0.72  23.63 0.73  23.73 0.74
        bike      25.60 0.68  26.05 0.70  25.03 0.65  25.34 0.67  25.78 0.69  25.85 0.70  26.15 0.70  26.30 0.71
        bus       24.69 0.77  25.28 0.79  23.92 0.73  24.47 0.75  24.93 0.78  25.05 0.78  25.17 0.75  25.43 0.79
        cow       23.12 0.55  23.22 0.56  22.67 0.52  22.89 0.54  23.20 0.56  23.08 0.55  23.18 0.55  23.15 0.55
        dog       25.58 0.56  25.74 0.57  25.15 0.54  25.65 0.57  25.88 0.58  25.83 0.59  25.95 0.59  25.94 0.60
        hike      23.67 0.56  23.81 0.57  23.10 0.51  23.20 0.52  23.46 0.55  23.65 0.55  23.80 0.57  23.85 0.57
        hockey    26.01 0.76  26.60 0.78  25.29 0.73  25.52 0.74  26.31 0.77  26.48 0.77  26.63 0.78  26.85 0.79
        average   24.55 0.63  24.83 0.65  24.01 0.60  24.42 0.63  24.75 0.65  24.87 0.65  25.01 0.66  25.12 0.67
        seconds   0.4829      0.4862      0.0057      0.0861      0.3013      0.4898      0.9067      0.4893
        """,
    ),
)

# The rows are the number of frames B of each view. DA&DNS is "w/o RN" of the ablation.
FRAMES = Table(
    "Dual view by number of frames, average of the twelve videos, no noise",
    "Table 4",
    _values(
        "GAP-TV, PnP-TV-FFD, DeSCI, U-net, ADMM-net, DA&DNS, OFaNet",
        """
        6        23.93 0.65  21.73 0.60  26.17 0.75  23.39 0.62  26.05 0.71  25.55 0.68  26.50 0.73
        seconds  11.8        49.5        17993.5     0.0214      0.0667      0.0052      0.3766
        10       22.49 0.60  22.54 0.57  24.51 0.64  22.97 0.55  24.14 0.60  24.01 0.60  25.12 0.67
        seconds  16.9        52.3        21600.4     0.0216      0.0680      0.0057      0.4893
        14       21.39 0.54  20.69 0.52  21.73 0.50  22.48 0.55  23.18 0.55  23.16 0.56  24.25 0.63
        seconds  28.7        90.0        60636.6     0.0215      0.0689      0.0058      0.9481
        """,
    ),
)

# The rows are the standard deviation of Gaussian noise, relative to measurements normalised to [0, 1]. The networks
# were trained without noise.
NOISE = Table(
    "Dual view by noise, B = 10, average of the twelve videos",
    "Table 5",
    _values(
        "GAP-TV, PnP-TV-FFD, DeSCI, U-net, ADMM-net, BIRNAT, OFaNet",
        """
        0     22.49 0.60  22.54 0.57  24.51 0.64  22.97 0.55  24.14 0.60  23.93 0.61  25.12 0.67
        0.01  21.69 0.53  20.54 0.51  22.79 0.56  22.88 0.54  23.76 0.58  23.45 0.59  24.83 0.65
        0.05  16.73 0.26  13.92 0.29  15.54 0.35  19.32 0.41  20.08 0.35  19.71 0.44  20.69 0.47
        0.1   13.12 0.12   9.94 0.16   8.65 0.14  16.12 0.26  16.36 0.18  16.07 0.33  17.09 0.34
        0.2    9.16 0.05   8.01 0.08   5.35 0.23  12.40 0.16  12.22 0.07  13.07 0.24  14.83 0.26
        """,
    ),
)

# The paper has the methods in rows and the videos in columns.
SINGLE_VIEW = Table(
    "Single view, B = 8, no noise",
    "Table 6",
    _values(
        "GAP-TV, DeSCI, U-net, ADMM-net, BIRNAT, OFaNet",
        """
        kobe     26.45 0.845  33.25 0.952  29.02 0.861  31.41 0.936  32.71 0.950  32.29 0.942
        traffic  20.89 0.715  28.72 0.925  23.45 0.838  27.40 0.918  29.33 0.942  28.76 0.926
        runner   28.81 0.909  38.76 0.969  34.43 0.958  37.18 0.971  38.70 0.976  38.37 0.970
        drop     34.74 0.970  43.22 0.993  36.77 0.974  40.71 0.989  42.28 0.992  41.84 0.990
        aerial   25.05 0.828  25.33 0.860  27.52 0.882  28.43 0.908  28.99 0.927  28.46 0.905
        vehicle  24.82 0.838  27.04 0.909  26.40 0.886  27.43 0.922  27.84 0.927  27.51 0.919
        average  26.79 0.858  32.72 0.935  29.26 0.900  32.09 0.941  33.31 0.951  32.88 0.942
        seconds  4.2          6180         0.023        0.067        0.16         0.14
        """,
    ),
)
