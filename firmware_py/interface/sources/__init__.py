"""The sources of messages and parameters, and the modules that generate code from them."""
