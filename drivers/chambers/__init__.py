"""Temperature chambers: one file per controller family."""
