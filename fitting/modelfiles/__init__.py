"""The parts of a model file: one module per kind of model, and the document around them.

To give a kind of model a file format, add a module here and a line in `fitting.modelfiles.kinds.KINDS`. The module has

    describe(estimator) -> dict      the parameters of a fitted estimator, as JSON values
    build(parameters, n_inputs)      the model they describe; `fitting.strict_json.Refused` for anything else

and the model has `predict(inputs)`, (n, k) to (n,), which neither fails nor needs memory beyond reason for any
parameters that `build` accepts. The estimator has `model_`, `training_` (a `fitting.training.TrainingRecord`) and
`get_params()`. Nothing registers itself: importing does nothing, and a file can only name a kind that is listed.
"""
