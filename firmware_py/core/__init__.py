"""The control blocks and their composition, `step(config, state, inputs) -> (state, outputs)`.

All modules use the strict subset of Python that `firmware_py.builds` compiles. Records made in every tick are
built with positional arguments: keyword arguments would cost the interpreter a tenth of the tick.
"""
