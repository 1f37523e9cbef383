"""The networks of the learned priors."""

LIMIT = 6.0  # standard deviations: largest change of a pixel; white noise exceeds it in one of 5e8 pixels
