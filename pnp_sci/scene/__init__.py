"""What of a scene must be modelled, decided from its measurement alone."""
