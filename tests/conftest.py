"""What a shell starts in its background is deaf to Ctrl-C, and so would be every process that tests start."""

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
