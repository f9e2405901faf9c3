"""The published tables of the reference experiment `ts`, as data.

Source: J. Chongqing Univ. 33(12), 2010: temperature x rate grid of a fibre-optic gyro, Takagi-Sugeno compensation.
The paper calls its second figure 'variance'; it can only be a standard deviation (0.026 as a variance is a standard
deviation of 0.16 deg/s, above the largest error of 0.12 deg/s it stands beside).
"""

from __future__ import annotations

from dataclasses import dataclass

EXPERIMENT = "ts"
SOURCE = "J. Chongqing Univ. 33(12), 2010"
POINTS = 648
TRAINING_POINTS = 448
VALIDATION_POINTS = 200
GYRO = "one fibre-optic gyro of the 0.3–1 °/h class, ±200 °/s full scale"


@dataclass(frozen=True)
class PublishedRow:
    """One row of both published tables, digits as printed, deg/s; `model` is the fogbench model beside it, if any."""

    label: str
    model: str
    max_train: str
    max_validation: str
    std_train: str
    std_validation: str


ROWS = (
    PublishedRow("No compensation", "none", "11.5764", "11.6008", "4.61936", "4.62689"),
    PublishedRow("Linear fit", "linear", "3.4732", "3.5006", "1.7316", "1.7306"),
    PublishedRow("LS-SVM", "ls_svm_published", "0.9287", "0.9301", "0.1924", "0.1923"),
    PublishedRow("BP network", "bp_gradient", "0.1335", "0.1764", "0.03121", "0.03565"),
    PublishedRow("T-S fuzzy model, as published", "ts_published", "0.12055", "0.14684", "0.02595", "0.02856"),
)
