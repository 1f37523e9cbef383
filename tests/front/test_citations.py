"""The papers behind a result."""

import numpy as np
import pytest
from operators_and_priors import by_name

import pnp_sci
from pnp_sci.datasets import embedded_scene
from pnp_sci.papers import references
from pnp_sci.plugins import registry
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result


def papers(prior, **options):
    scene = embedded_scene(32)
    return pnp_sci.citations(pnp_sci.solve(scene.y, scene.masks, prior, iterations=3, **options))


def named(authors, listed):
    return any(authors in paper for paper in listed)


@pytest.mark.parametrize(
    ("prior", "authors"),
    [
        ("tv", ["Chambolle"]),
        ("wavelet", ["Coifman"]),
        ("bm3d", ["Dabov", "Chambolle"]),
        ("flow", ["Kroeger", "Buades", "Dabov", "Chambolle"]),
        ("desci", ["Rank minimization", "Gu", "Kroeger", "Chambolle"]),
        ("tv+wavelet", ["Chambolle", "Coifman", "Y. Yu"]),
        ([("tv", 1), ("wavelet", 2)], ["Chambolle", "Coifman"]),
        by_name("ffdnet", ["Zhang"]),
        by_name("video", ["Zhang", "Tassano"]),
    ],
)
def test_priors_name_their_papers_and_those_of_what_they_use(prior, authors):
    listed = papers(prior, init="adjoint")  # with the warm-up
    for name in authors:
        assert named(name, listed), name


def test_names_and_objects_have_the_same_papers():
    from priors.bm3d import BM3D

    assert papers("bm3d") == papers(BM3D())


def test_the_algorithm_is_named():
    assert named("Liao", papers("none"))
    assert not named("Liao", papers("none", algorithm="admm"))
    assert named("Elgendy", papers("none", algorithm="admm"))
    assert not named("Chambolle", papers("none"))


def test_decoders_name_theirs():
    pytest.importorskip("torch")
    scene = embedded_scene(32)
    title = "Dual-view snapshot compressive imaging"
    assert named(title, pnp_sci.citations(pnp_sci.decode(scene.y, scene.masks)))
    assert named(title, papers("tv", init="ofanet"))
    assert not named(title, papers("tv"))


def test_references_are_whole_and_come_once():
    listed = papers("flow")
    assert len(set(listed)) == len(listed)
    for paper in listed:
        assert "\n" not in paper
        assert '"' in paper, "a title"
        assert any(str(year) in paper for year in range(1950, 2030)), "a year"


@pytest.mark.parametrize("name", sorted(registry.available("priors")))
def test_every_installed_prior_has_references(name):
    assert references(registry.load("priors", name))


def test_a_registered_prior_is_heard(monkeypatch):
    def own():
        """Leaves things as they are.

        References
        ----------
        .. [1] A. Uthor, "A title that
           goes on", 2001.
        .. [2] B. Other, "Another", 2002.

        Examples
        --------
        Dr. No.
        """
        return lambda x, sigma: x

    monkeypatch.setitem(registry._registered["priors"], "own", own)
    listed = papers("own")
    assert listed[-2:] == ['A. Uthor, "A title that goes on", 2001.', 'B. Other, "Another", 2002.']


def test_results_of_other_installations_and_versions_are_heard(tmp_path):
    settings = {"prior": "gone+tv", "algorithm": "gap", "init": "lost"}
    result = Result(np.ones((1, 1, 2, 2)), Status.CONVERGED, History(), settings)
    result.save(tmp_path / "old.npz")
    listed = pnp_sci.citations(Result.load(tmp_path / "old.npz"))
    assert named("Chambolle", listed)


def test_references_may_be_those_of_a_class():
    class Two:
        """Both.

        References
        ----------
        Those of :class:`priors.tv.TV` and :class:`priors.bm3d.BM3D`.
        A. Uthor, "A title", 2001.
        """

    from priors.bm3d import BM3D
    from priors.tv import TV

    assert references(Two) == [*references(TV), *references(BM3D), 'A. Uthor, "A title", 2001.']
    assert references(None) == references(lambda: None) == []
