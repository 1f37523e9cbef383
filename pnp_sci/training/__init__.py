"""What the trainers of learned parts share: clips, and the loop to the end of a budget. Needs torch."""
