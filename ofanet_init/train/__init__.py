"""Trainer of OFaNet: ``python -m ofanet_init.train --stage STAGE --data DIR``; stages dns, flow, refine and joint."""
