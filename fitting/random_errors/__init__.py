"""Random errors of a gyro: Allan deviation and its coefficients, autoregression, Kalman smoothing."""
