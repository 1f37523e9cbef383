"""Trainer of the learned priors: ``python -m priors.train video --data DIR --minutes 90``.

Every process of ``torchrun -m priors.train ...`` takes its share; one process alone needs no launcher.
"""
