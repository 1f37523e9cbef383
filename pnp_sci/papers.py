"""The papers behind a result: priors and decoders name theirs in their docstrings, the solvers' are listed here."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from pnp_sci._validate import needed
from pnp_sci.errors import UnknownPluginError
from pnp_sci.plugins import combine, registry
from pnp_sci.results.result import Result
from pnp_sci.sensing.mosaic import Mosaic

PLUG_AND_PLAY = (
    'S. V. Venkatakrishnan, C. A. Bouman & B. Wohlberg, "Plug-and-play priors for model based reconstruction", IEEE '
    "Global Conference on Signal and Information Processing (2013)."
)
FOR_SCI = (
    'X. Yuan, Y. Liu, J. Suo & Q. Dai, "Plug-and-play algorithms for large-scale snapshot compressive imaging", CVPR '
    "(2020)."
)
GAP = (
    'X. Liao, H. Li & L. Carin, "Generalized alternating projection for weighted-l2,1 minimization with applications '
    'to model-based compressive sensing", SIAM Journal on Imaging Sciences 7 (2014).'
)
ADMM = (
    'S. H. Chan, X. Wang & O. A. Elgendy, "Plug-and-play ADMM for image restoration: fixed-point convergence and '
    'applications", IEEE Transactions on Computational Imaging 3 (2017).'
)
SHRINKAGE = (
    'W. James & C. Stein, "Estimation with quadratic loss", Proceedings of the Fourth Berkeley Symposium on '
    "Mathematical Statistics and Probability 1 (1961)."
)
ALGORITHMS = {"gap": GAP, "plain-gap": GAP, "admm": ADMM}


def citations(result: Result) -> list[str]:
    """References to the papers behind a result, in the order: solver, priors, decoder.

    Priors and decoders are those that `result.settings` records; they name their papers in the section "References" of
    their docstrings. One that is not installed here is left out.

    Parameters
    ----------
    result : Result

    Returns
    -------
    list of str
        Each reference once.

    Raises
    ------
    InputTypeError
        If it is no Result.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(32)
    >>> for paper in citations(pnp_sci.solve(scene.y, scene.masks, "bm3d", scene="full")):
    ...     print(paper.partition(", ")[0])
    S. V. Venkatakrishnan
    X. Yuan
    X. Liao
    K. Dabov
    R. Lu
    W. James & C. Stein
    """
    needed("result", result, Result)
    return list(dict.fromkeys(_papers(result.settings)))


def references(documented: Any) -> list[str]:
    """The entries of the section "References" of a docstring, each in one line.

    An entry ends with a full stop at the end of a line, or where the next begins with ``.. [1]`` or ``-``. Where one
    refers to a class or function, as in "Those of :class:`priors.tv.TV`.", the references of that take its place.
    """
    entries: list[str] = []
    ended = True
    for line in _section(inspect.getdoc(documented) or "", "References"):
        mark = re.match(r"(\.\. \[\w+\]|-|\*) +", line)
        text = line[mark.end() if mark else 0 :].strip()
        if text and (mark or ended):
            entries.append(text)
        elif text:
            entries[-1] += f" {text}"
        ended = not text or text.endswith(".")
    return [paper for entry in entries for paper in _followed(entry)]


def _papers(settings: dict[str, Any]) -> Iterator[str]:
    prior = settings.get("prior")
    if prior is not None:
        yield from [] if prior == "none" else [PLUG_AND_PLAY, FOR_SCI]
        yield ALGORITHMS[settings["algorithm"]]
    if settings.get("mosaic"):
        yield from references(Mosaic)
    reprs = [turn["prior"] for plan in settings.get("plan", []) for turn in plan["serves"]]
    reprs.append(str(prior))
    classes = registry.makers("priors")
    for name in re.findall(r"(\w+)\(", " ".join(reprs)):
        if name in classes:
            yield from references(_loaded("priors", classes[name]))
        elif isinstance(part := getattr(combine, name, None), type):
            yield from references(part)
    for name in _names(prior):
        yield from references(_loaded("priors", name))
    for name in (settings.get("init"), settings.get("model")):
        yield from references(_loaded("decoders", name))
    if any(share for shares in settings.get("share", []) for share in shares):
        yield SHRINKAGE


def _names(prior: Any) -> list[str]:
    """The names in a prior as `Result.settings` holds it: a name, names joined by "+", or stages."""
    if isinstance(prior, str):
        return [name.strip() for name in prior.split("+")]
    return [name for stage, _ in prior or [] for name in _names(stage)]


def _loaded(kind: str, name: Any) -> Any:
    """The plugin, or None where there is none of that name."""
    try:
        return registry.load(kind, name)
    except UnknownPluginError:
        return None


def _section(docstring: str, title: str) -> list[str]:
    """The lines of a section of a numpydoc docstring."""
    lines = docstring.splitlines()
    titles = [n for n, line in enumerate(lines[1:]) if re.fullmatch("-{3,}", line.strip())]
    begins = next((n for n in titles if lines[n].strip() == title), None)
    if begins is None:
        return []
    ends = min((n for n in titles if n > begins), default=len(lines))
    return lines[begins + 2 : ends]


def _followed(entry: str) -> list[str]:
    """An entry, or the references of the classes and functions that it refers to."""
    paths = re.findall(r":(?:class|func):`~?([\w.]+)`", entry)
    if not paths:
        return [entry]
    parts = [path.rpartition(".") for path in paths]
    return [paper for module, _, name in parts for paper in references(getattr(import_module(module), name))]
