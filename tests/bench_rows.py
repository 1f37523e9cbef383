"""Rows as a bench on this machine would have measured them: ``from bench_rows import QUICK, SLOW, row``."""

from pnp_sci.advice.recommend import calibrate
from pnp_sci.bench import Case, Checkpoint, Method, Row

TV = Method("tv")


def row(scene="car-b_car-w", method=TV, course=((0, 0.1, 15.0), (5, 0.2, 20.0), (10, 0.4, 22.0)), **other):
    """A row as if it had been measured on a machine as quick as this one."""
    points = tuple(Checkpoint(iteration, seconds, quality, 0.1) for iteration, seconds, quality in course)
    facts = dict(
        case=Case(scene), method=method, shape=(2, 10, 256, 256), status="iterations", iterations=10, psnr=(21.0, 23.0),
        ssim=(0.5, 0.7), seconds=(0.4,), loading=3.0, peak_mib=200.0, course=points, settings={},
        machine={"calibration": calibrate()},
    )  # fmt: skip
    return Row(**(facts | other))


QUICK = row(method=Method("quick"))
SLOW = row(method=Method("slow"), course=((0, 0.3, 15.0), (10, 2.0, 25.0), (20, 3.0, 24.0)))
