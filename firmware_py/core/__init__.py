"""What the microcontroller would run: config, state and `step(config, state, inputs) -> (state, outputs)`."""
