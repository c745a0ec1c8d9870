"""Commands for design: tuning, trade, schedule, simulation, studies."""
