"""For all tests: one thread for linear algebra, Ctrl-C for what they start, no time limit on properties."""

import signal

from hypothesis import settings

import tools  # noqa: F401 - keeps linear algebra to one thread

# What a shell starts in its background is deaf to Ctrl-C, and so would be every process that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
