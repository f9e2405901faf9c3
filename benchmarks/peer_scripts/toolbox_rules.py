"""anfis-toolbox: hybrid training from a grid of four sets an input; more epochs than 100 gain little here."""

from anfis_toolbox import ANFISRegressor  # type: ignore[import-not-found]
from handover import Correction, main

if __name__ == "__main__":
    main("anfis-toolbox", {"16 rules": lambda: Correction(ANFISRegressor(n_mfs=4, learning_rate=0.1, random_state=0))})
