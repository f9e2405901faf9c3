"""The orchestrator: turns a procedure into a record."""
