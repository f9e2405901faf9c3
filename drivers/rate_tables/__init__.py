"""Rate tables: one file per controller family."""
