"""Which method suits a time budget on this machine."""
