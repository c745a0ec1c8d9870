"""The vibro-impact module (striker, drive, friction, stop, motor and sensors) and its solvers."""
