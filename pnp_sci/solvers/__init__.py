"""Solvers as pure steps, state in and state out, and the one loop that drives them."""
