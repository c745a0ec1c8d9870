"""The nodes on the bus (plant, firmware and operator) and their processes."""
