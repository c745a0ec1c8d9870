"""The plant on the bus: its node, the steps of a tick, sensors with periods of their own, and its runner."""
