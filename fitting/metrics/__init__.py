"""The figures a gyro laboratory reports, each with its definition, its uncertainty and the clause it comes from."""
