"""A virtual bench for the tests of users' own repositories: a pytest plugin and what its fixtures give."""
