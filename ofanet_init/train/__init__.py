"""Trainer of OFaNet: ``python -m ofanet_init.train --stage dns --data DIR --minutes 20``, then flow, refine, joint."""
