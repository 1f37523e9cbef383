"""The measurement y = Phi x + noise: sensing operator, camera, noise, and scene model."""
