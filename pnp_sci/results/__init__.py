"""What a solver returns: the video, its history and how both are stored."""
