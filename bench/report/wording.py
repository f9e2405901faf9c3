"""What models, splits, quantities and columns are called in the report; unknown names are shown as they are."""

from __future__ import annotations

MODELS = {
    "none": "not compensated",
    "linear": "linear",
    "ts_published": "T-S published",
    "ts_joint": "T-S joint",
    "ls_svm_published": "LS-SVM, untuned",
    "ls_svm": "LS-SVM, tuned",
    "bp_gradient": "BP network, gradient",
    "bp_lm": "BP network, Levenberg–Marquardt",
    "polynomial": "polynomial",
    "rbf": "radial basis spline",
    "gaussian_process": "Gaussian process",
    "svr": "ε-SVR",
    "ts_auto": "T-S, rules chosen",
    "automatic": "chosen by cross-validation",
}
SPLITS = {
    "leave_temperatures_out": "leave temperatures out",
    "random": "random split, held-back points",
    "random_train": "random split, training points",
}
QUANTITIES = {
    "max_abs_dps": "largest error",
    "std_dps": "standard deviation of the error",
    "times_floor": "standard deviation of the error in noise floors",
    "rms_mil": "rms error in mil",
}
COLUMNS = (
    ("point, dut", "number of the point in the order measured; serial number of the DUT: one row per point and DUT"),
    ("dwell", "number of the stay at one chamber setpoint; leave-temperatures-out leaves out whole dwells"),
    (
        "chamber_setpoint_degc, chamber_readback_degc",
        "what the chamber was asked for, and what its own sensor said, °C",
    ),
    ("dut_temperature_degc", "mean of the DUT's own temperature sensor over the acquisition, °C"),
    (
        "dut_temperature_slope_degc_min, dut_temperature_slope_u_degc_min",
        "slope of that temperature during the acquisition, and its standard uncertainty, °C/min",
    ),
    (
        "rate_setpoint_dps, rate_readback_dps, rate_worst_dps",
        "what the table was asked for; the mean of what it said during the acquisition, and what was farthest off, °/s",
    ),
    (
        "rate_reference_dps",
        "what the DUT should have measured: rate setpoint plus the earth rate along the table axis, °/s",
    ),
    ("rate_mean_dps, rate_std_dps", "mean and standard deviation of the samples of the point, °/s"),
    ("rate_mean_u_dps", "standard uncertainty of the mean, noise of the samples with their correlation, °/s"),
    (
        "noise_ratio",
        "standard deviation of the samples over the median of the DUT's own points before it at comparable rates",
    ),
    ("samples, frames", "samples averaged; frames received during the acquisition"),
    ("frames_lost, duplicates, bad_checksum", "frames that did not arrive, arrived twice, or arrived damaged"),
    ("skipped_bytes, resyncs", "bytes the decoder skipped, and how often, to find the next good frame"),
    ("frames_held", "frames that only repeat the one before, more often than noise can: the output was frozen"),
    ("spikes", "single frames far off, left out before samples were made (8 scaled MAD)"),
    ("outliers", "samples left out before averaging (6 scaled MAD)"),
    ("started_at_s, ended_at_s", "acquisition on the bench clock, seconds from the start of the run"),
    ("verdict, reasons", "pass, marginal or fail, and why; failed points are kept in the file and left out of figures"),
)
TERMS = (
    ("DUT", "the gyro under test."),
    ("point", "one averaged row: one DUT at one temperature and one rate."),
    ("dwell", "all points measured at one chamber setpoint after one soak."),
    ("error", "what the DUT says minus the reference rate; before compensation the mean output itself is compared."),
    ("residual", "what is left of the error after compensation."),
    ("max", "the largest magnitude of the error over the judged points."),
    ("std", "the standard deviation of the error over the judged points (spread of points, not noise of samples)."),
    (
        "noise floor",
        "root mean square of the standard uncertainties of the judged points: what the noise of their samples alone "
        "would leave. Repeatability between dwells is not in it.",
    ),
    (
        "repeatability between dwells",
        "how far the output at the same temperature and rate differs from one dwell to another. It shows only if a "
        "temperature is visited more than once.",
    ),
    (
        "leave temperatures out",
        "every point is predicted by a model that was fitted without any point of its dwell; the honest figure for a "
        "temperature that was not calibrated.",
    ),
    (
        "random split",
        "points held back at random; their dwell is in the training set, so errors common to it are learnt.",
    ),
)


def model_name(model: str) -> str:
    """The model as a reader knows it: 'T-S joint' for 'ts_joint'."""
    return MODELS.get(model, model)


def split_name(split: str) -> str:
    """The split in words."""
    return SPLITS.get(split, split)


def quantity_name(quantity: str) -> str:
    """The judged quantity in words."""
    return QUANTITIES.get(quantity, quantity)
