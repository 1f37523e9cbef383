"""A scene whose masks are not where they were calibrated: ``from moved import moved, seen_through``."""

import numpy as np
from scipy.ndimage import affine_transform


def moved(planes, shift=(0.0, 0.0), degrees=0.0, scale=1.0, order=1):
    """Planes (..., H, W) shifted by rows and columns, turned and scaled about the centre, by scipy alone."""
    angle, centre = np.deg2rad(degrees), (np.array(planes.shape[-2:]) - 1) / 2
    forward = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    back = np.linalg.inv(forward)
    offset = centre - back @ (centre + shift)
    out = np.empty(planes.shape)
    for place in np.ndindex(planes.shape[:-2]):
        affine_transform(planes[place].astype(float), back, offset, output=out[place], order=order, mode="reflect")
    return out


def seen_through(masks, video):
    """The measurement (H, W) of a video (V, B, H, W), in float64."""
    return np.einsum("vbhw,vbhw->hw", masks.astype(float), video.astype(float))
