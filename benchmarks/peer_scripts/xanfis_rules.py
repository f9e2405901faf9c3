"""xanfis: hybrid training (gradient for the sets, least squares for the consequents), whole batches.

Settings are the best of a few tried on these data; eight rules do worse than either.
"""

from typing import Any

from handover import Correction, main
from xanfis import AnfisRegressor  # type: ignore[import-not-found]


def rules(n_rules: int, epochs: int, rate: float) -> Any:
    return AnfisRegressor(
        num_rules=n_rules,
        epochs=epochs,
        batch_size=1000,
        optim_params={"lr": rate},
        early_stopping=False,
        valid_rate=None,
        seed=0,
        verbose=False,
    )


if __name__ == "__main__":
    main(
        "xanfis",
        {
            "4 rules": lambda: Correction(rules(4, 500, 0.1)),
            "12 rules": lambda: Correction(rules(12, 300, 0.05)),
        },
    )
