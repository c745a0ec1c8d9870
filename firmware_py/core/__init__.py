"""The control blocks and their composition, `step(config, state, inputs) -> (state, outputs)`.

All modules use the strict subset of Python that `firmware_py.builds` compiles.
"""
