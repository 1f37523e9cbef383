"""One measurement from start to end: defaults, first estimate, solver, blend and record."""
