"""The vibro-impact module: striker, drive, friction, stop, motor and sensors, and the solvers that move them."""
