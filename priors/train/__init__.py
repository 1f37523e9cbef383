"""Trainer of the learned priors: ``python -m priors.train video --data DIR --minutes 90``.

``torchrun -m priors.train ARGUMENTS`` trains with several processes.
"""
