"""For all tests: Ctrl-C reaches the processes that they start, and no test of properties is timed."""

import signal

from hypothesis import settings

# What a shell starts in its background is deaf to Ctrl-C, and so would be every process that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
