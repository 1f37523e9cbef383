"""Files of the field as arrays."""
