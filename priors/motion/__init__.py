"""Motion estimation between the frames of a view, and averages along the motion."""
