"""The tools: command line, studies, tuning and inspection."""
