"""Motion between the frames of a view, and averages along it."""
