"""Fitted models for other programs: C99 for the gyro's own processor, tables of coefficients for everything else.

One module per form of model (`fitting.export.forms.FORMS`) says what its tables are, how its output is computed in C,
what that costs and how it rounds; the rest, from the guard to the self-test, is the same for all of them.
"""
