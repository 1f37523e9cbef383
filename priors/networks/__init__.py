"""The networks behind the learned priors."""

LIMIT = 6.0  # no pixel changes by more standard deviations: white noise exceeds it once in 5e8 pixels
