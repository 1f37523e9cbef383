"""What the code of the masks, as it is found in a measurement, says of them."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.code import Code, Match
from pnp_sci.camera.fit import Finding
from pnp_sci.camera.light_line import light_line
from pnp_sci.camera.orientations import in_pairs, search

SURELY = 5.0  # standard errors: beyond chance in any one of some dozen tests, also with few blocks
LIKELY = 3.0  # standard errors, beside a limit that is itself far from what is right
MATERIAL = 0.05  # of what the masks explain: a better position explains that much beside
TELLS = 0.2  # standard error of the light that follows the code, from which on it tells nothing
HALF = 0.5  # of the light: what follows the masks less was not seen through them
FIFTH = 0.2  # of the light: masks of which so much is followed are the right ones, of which less are not
TENTH = 0.1  # of the light: calibrated masks of real cameras miss half of that

REGISTER = "pnp_sci.register(y, masks) estimates it, solve(..., register=True) corrects it"
WRONG = f"masks may be moved, turned or blurred: {REGISTER}; or some are missing or wrong"
GAMMA = "y may not be linear: switch off gamma"


def told(match: Match) -> bool:
    """Whether the measurement tells if the masks fit."""
    return match.error < TELLS or match.level.errors > SURELY


def shift_of(code: Code, y: np.ndarray, match: Match, mirrored: tuple[int, int] | None) -> tuple[float, float] | None:
    """By how many pixels the masks must be moved; None if they are where they belong, or are no masks of y (H, W).

    `mirrored`: how masks that move by a constant step must be moved to have the sum of masks that move the other way.
    """
    if match.lag.errors > SURELY and match.lag.gain > MATERIAL:
        lag = int(match.lag.value[0]), int(match.lag.value[1])
        moved = {shift: Code(np.roll(code.sums, shift, (1, 2)), code.good).match(y) for shift in (lag, mirrored or lag)}
        best = max(moved, key=lambda shift: moved[shift].share)
        return best if _are_right(moved[best]) else None
    if match.off.errors > SURELY and match.off.gain > MATERIAL and _are_right(match):
        return match.off.value  # type: ignore[return-value]
    return None


def _are_right(match: Match) -> bool:
    """Whether enough of the light follows the masks, or their inverse, to tell that they are those of y."""
    return match.error >= TELLS or abs(match.follows) > max(SURELY * match.error, FIFTH)


def judge_code(
    code: Code, y: np.ndarray, match: Match, shift: tuple[float, float] | None, mirrored: tuple[int, int] | None
) -> list[Finding]:
    """What is wrong with masks or measurement y (H, W): one finding at most, as each hides those that follow."""
    moved = shift is not None or not _are_right(match)
    if moved and (swapped := _in_pairs(code, y, match, shift or match.lag.value)):
        return swapped
    if shift is not None:
        return [_moved(shift, mirrored)]
    if match.turn.errors > SURELY and match.turn.gain > MATERIAL and _are_right(match):
        return [Finding("shift", "masks turned or magnified a little explain more of y", REGISTER)]
    if not code.tells_light:
        return []
    if match.error >= TELLS:
        if match.level.errors <= SURELY:
            return _others(code, y, match, mirrored, certain=False)
        if max(match.level.value, key=abs) < 0:
            return [_inverted()]
        return [_subtracted(match)] if match.light + LIKELY * match.light_error < 1 - TENTH else []
    if match.follows + SURELY * match.error < 0 and match.share > MATERIAL:
        return [_inverted()]
    if match.follows + LIKELY * match.error < HALF:
        return _others(code, y, match, mirrored, certain=True)
    low = match.follows + LIKELY * match.error < 1 - TENTH
    high = match.follows - LIKELY * match.error > 1 + TENTH
    if (low or high) and match.blur.errors > SURELY and abs(match.blur.gain) > MATERIAL:
        return [_sharpness(match)]
    return [_weak(code, y, match)] if low else [_contrast(match)] if high else []


def _in_pairs(code: Code, y: np.ndarray, match: Match, shift: tuple[float, ...]) -> list[Finding]:
    """Lines of y that are swapped in pairs: masks arranged so explain more than those moved by `shift`."""
    moved = Code(np.roll(code.sums, np.rint(shift).astype(int), (1, 2)), code.good).match(y)
    for axis, name in ((1, "rows"), (2, "columns")):
        if code.sums.shape[axis] % 2:
            continue
        other = Code(in_pairs(code.sums, axis), code.good).match(y)
        if other.follows > HALF and _are_right(other) and other.share > max(match.share, moved.share) + MATERIAL:
            text = f"y follows the masks better with {name} swapped in pairs"
            order = f"y[..., np.arange({code.sums.shape[axis]}) ^ 1{', :' * (axis == 1)}]"
            return [Finding("arrangement", text, f"y may be read in a wrong order; try {order}")]
    return []


def _moved(shift: tuple[float, float], mirrored: tuple[int, int] | None) -> Finding:
    if shift == mirrored:
        return _other_way(shift)
    whole = all(isinstance(s, int) for s in shift)
    size = "({}, {})".format(*shift) if whole else "({:.1f}, {:.1f})".format(*np.clip(shift, -1, 1))
    return Finding("shift", f"masks moved by about {size} pixels, in rows and columns, explain more of y", REGISTER)


def _other_way(shift: tuple[float, float]) -> Finding:
    """The sum of masks says the same of both: the order of the frames differs."""
    text = "masks that move the other way explain more of y, or these moved by ({}, {}) pixels".format(*shift)
    how = "masks[:, ::-1] moved so are the former; of the two, keep those whose video moves smoothly"
    return Finding("shift", text, how)


def _others(code: Code, y: np.ndarray, match: Match, mirrored: tuple[int, int] | None, certain: bool) -> list[Finding]:
    """Masks that y does not follow: those that it does, or why there may be none."""
    found = search(code, y)
    if found is not None and _are_right(Code(found.arranged(code.sums), code.good).match(y)):
        if found.name == "as they are" and found.shift == mirrored:
            return [_other_way(found.shift)]
        moved = "" if found.shift == (0, 0) else ", moved by ({}, {}) pixels".format(*found.shift)
        text = f"y does not follow the masks, but it follows them {found.name}{moved}"
        how = "give the masks so" + (", and 1 - masks" if found.inverted else "")
        return [Finding("shift" if found.name == "as they are" else "arrangement", text, how)]
    if not certain:
        return []
    if match.follows > max(SURELY * match.error, FIFTH):
        return [_weak(code, y, match)]
    if match.contrast < HALF:
        text = "y has less fine detail than such masks leave"
        return [Finding("no code", text, "it seems to be divided by the sum of masks or averaged; give it as recorded")]
    text = f"y does not follow the masks ({match.follows:.2f} of its light does)"
    hint = "they may be those of another setup, or move another way, or y may be divided by their sum"
    hint += "; check files, date and crop"
    return [Finding("no code", text, hint)]


def _inverted() -> Finding:
    return Finding("inverted", "y is dark where the masks are open", "masks or y are inverted; try 1 - masks")


def _sharpness(match: Match) -> Finding:
    soft = match.blur.value[0] > 0
    hint = "focus of the calibration and of the capture may differ; calibrate the masks as y is recorded"
    hint += f", or blur them: {REGISTER}" if soft else ""
    return Finding("sharpness", f"the code in y is {'less' if soft else 'more'} sharp than the masks", hint)


def _weak(code: Code, y: np.ndarray, match: Match) -> Finding:
    """What it means that part of the light does not follow the masks."""
    levels = match.level.value
    unseen = [str(v) for v, level in enumerate(levels, 1) if level < FIFTH * max(levels)]
    text = f"{1 - match.follows:.0%} of the light in y does not follow the masks"
    if unseen and match.level.errors > SURELY:
        text += f", and none follows those of view {', '.join(unseen)}"
        hint = f"masks of a view may be wrong or moved: {REGISTER}; or the view is dark, and y has a black level"
        return Finding("black level", text, hint)
    constant, part = light_line(code, y)
    if part and not constant:
        text = f"the code in y is {match.follows:.2f} times as strong as the masks say, in bright and dark parts alike"
        return Finding("contrast", text, f"{WRONG}; or {GAMMA}")
    subtract = "subtract the black level of the camera, or stray light, from y"
    hint = f"{subtract}; or {WRONG}" if constant and not part else f"{WRONG}; or {subtract}; or {GAMMA}"
    return Finding("black level", text, hint)


def _contrast(match: Match) -> Finding:
    text = f"the code in y is {match.follows:.2f} times as strong as the masks say"
    hint = "too much may have been subtracted from y, or the masks' own black level has not been subtracted"
    return Finding("contrast", text, hint)


def _subtracted(match: Match) -> Finding:
    text = f"the mean of y is {round(100 * match.light)}% of the light that follows the masks"
    hint = "too much has been subtracted from y; give it as recorded, or let register=True estimate the black level"
    return Finding("contrast", text, hint)
