"""A training run that is interrupted: ``from interrupting import interrupted_before``."""

from contextlib import contextmanager

import pytest


@contextmanager
def interrupted_before(step):
    """Trainings stop with a KeyboardInterrupt when so many steps are done."""
    loop = pytest.importorskip("pnp_sci.training.loop")
    going_on = loop.Trainer.step

    def interrupted(trainer, done):
        if trainer.progress.step == step:
            raise KeyboardInterrupt
        return going_on(trainer, done)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop.Trainer, "step", interrupted)
        yield
