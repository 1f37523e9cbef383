"""The networks behind the learned priors."""
