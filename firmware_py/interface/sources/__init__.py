"""The sources of messages and parameters, and the modules that write code out of them."""
