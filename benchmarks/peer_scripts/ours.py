"""Our own models, through the same door as the peers."""

from handover import main

from fitting.ls_svm import LeastSquaresSVM
from fitting.takagi_sugeno import TakagiSugeno

if __name__ == "__main__":
    main(
        "fogbench",
        {
            "joint 4": lambda: TakagiSugeno(4),
            "joint 6": lambda: TakagiSugeno(6),
            "published 4": lambda: TakagiSugeno(4, "gustafson_kessel", "recursive"),
            "ls-svm": LeastSquaresSVM,
        },
    )
