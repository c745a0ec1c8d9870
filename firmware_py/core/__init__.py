"""What the microcontroller would run: config, state and `step(config, state, inputs) -> (state, outputs)`.

All of it is the strict subset that `firmware_py.builds` compiles. The records that are made in every tick are
built by position, in the order of their fields: keywords would cost the interpreter a tenth of the tick.
"""
