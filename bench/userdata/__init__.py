"""Users' own recordings, as CSV or Parquet: fit a model to one, compensate one, without a bench."""
