"""Many measurements, out of core, on one computer or on a cluster."""
