"""What priors do on tensors of torch; each module imports torch."""
