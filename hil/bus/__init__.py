"""Every bus behind one `open_bus(spec)`."""
