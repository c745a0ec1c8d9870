"""For all tests: one thread for linear algebra, rare garbage collections, Ctrl-C, untimed properties."""

import signal

from hypothesis import settings

import tools  # noqa: F401 - keeps linear algebra to one thread
from hil.timing.realtime import collect_rarely

collect_rarely()

# What a shell starts in its background is deaf to Ctrl-C, and so would be every process that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
