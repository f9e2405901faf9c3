"""pyFUME: fuzzy c-means, Gaussian sets, first-order rules. Its own Gustafson-Kessel does worse on this surface."""

from typing import Any

import numpy as np
import pandas as pd
from handover import Correction, main
from pyfume import pyFUME  # type: ignore[import-not-found]


class Rules:
    """pyFUME behind fit and predict; it draws its starts from numpy's global generator."""

    def __init__(self, n_rules: int) -> None:
        self.n_rules = n_rules

    def fit(self, X: Any, y: Any) -> None:
        np.random.seed(0)  # noqa: NPY002
        frame = pd.DataFrame(np.column_stack([X, y]), columns=["temperature", "output", "rate"])
        self.model = pyFUME(
            dataframe=frame,
            nr_clus=self.n_rules,
            data_split_method="no_split",
            setnes_threshold=1.0,  # with its default, 0.9, and without a split of its own it ends in a TypeError
            save_simpful_code=False,
        )

    def predict(self, X: Any) -> Any:
        return self.model.predict_label(X)


if __name__ == "__main__":
    # With four rules the rate itself is fitted better than the correction, with eight the correction.
    main("pyFUME", {"4 rules": lambda: Rules(4), "8 rules": lambda: Correction(Rules(8))})
