"""Settings of the tests of the orchestrator."""

from hypothesis import settings

# No test times anything: on a busy machine a single example may take any time.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
