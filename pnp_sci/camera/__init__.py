"""What a real camera does to a measurement: masks that do not fit, bad pixels, calibration."""
