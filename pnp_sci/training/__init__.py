"""Shared code of the trainers: clips and the training loop. Needs torch."""
