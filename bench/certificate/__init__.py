"""The calibration certificate of one DUT: one page, as HTML and as PDF, from a run that ended."""
