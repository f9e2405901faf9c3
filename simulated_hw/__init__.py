"""The same instruments as physics, in virtual time, speaking the same bytes."""
