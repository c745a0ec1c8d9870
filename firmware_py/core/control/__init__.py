"""Control of the motor: starting, holding, following a gait, stopping."""
