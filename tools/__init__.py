"""What people sit down with: the command line, studies, tuning and inspection."""
