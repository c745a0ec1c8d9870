"""The nodes on the bus: plant, firmware and operator, and what a process of each runs."""
