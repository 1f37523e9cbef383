"""The measurement: y = Phi x + noise, with the camera, its noise and what of a scene is modelled."""
