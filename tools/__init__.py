"""The tools: command line, studies, tuning and inspection."""

from tools.one_thread import keep_to_one_thread

keep_to_one_thread()  # before anything imports numpy
