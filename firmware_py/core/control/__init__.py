"""Control of the motor: starting, holding, stopping."""
