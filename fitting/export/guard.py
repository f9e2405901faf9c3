"""The guard of `fitting.reach` in C: rows outside the training range are brought back to it, and said to be outside."""

from itertools import combinations

from fitting.export.form import Label, Operations, Table, labels
from fitting.modelfile import Compensation
from fitting.reach import MARGIN, Reach

# `Reach.bring_inside`: to the box, then straight towards the centre as far as sums and differences ask for.
BOX = """\
static int bring_inside(const real x[INPUTS], real held[INPUTS])
{
    int i, outside = 0;
    for (i = 0; i < INPUTS; ++i) {
        held[i] = x[i] < low[i] ? low[i] : x[i] > high[i] ? high[i] : x[i];
        if (!(held[i] == x[i]))
            outside = 1;
    }
    return outside;
}
"""
POLYTOPE = """\
static real least(real share, real value, real lower, real upper)
{
    const real limit = value > (real)0 ? upper : lower;
    const real allowed = value == (real)0 ? (real)1 : limit / value;
    return allowed < share ? allowed : share;
}

static int bring_inside(const real x[INPUTS], real held[INPUTS])
{
    real scaled[INPUTS], share = (real)1;
    int i, j, p = 0, outside = 0;
    for (i = 0; i < INPUTS; ++i) {
        held[i] = x[i] < low[i] ? low[i] : x[i] > high[i] ? high[i] : x[i];
        scaled[i] = (held[i] - middle_of_range[i]) / half_range[i];
    }
    for (i = 0; i < INPUTS; ++i)
        for (j = i + 1; j < INPUTS; ++j, ++p) {
            share = least(share, scaled[i] + scaled[j], sum_low[p], sum_high[p]);
            share = least(share, scaled[i] - scaled[j], difference_low[p], difference_high[p]);
        }
    for (i = 0; i < INPUTS; ++i) {
        if (share < (real)1)
            held[i] = middle_of_range[i] + share * (held[i] - middle_of_range[i]);
        if (!(held[i] == x[i]))
            outside = 1;
    }
    return outside;
}
"""


def code(reach: Reach) -> str:
    """The function bring_inside."""
    return BOX if reach.sums is None else POLYTOPE


def tables(compensation: Compensation) -> tuple[Table, ...]:
    """The limits it needs."""
    reach, inputs = compensation.reach, labels(compensation.inputs)
    box = (Table.of("low", inputs, reach.low), Table.of("high", inputs, reach.high))
    if reach.sums is None or reach.differences is None:
        return box
    names = [column.name for column in compensation.inputs]
    pairs = list(combinations(names, 2))
    sums, differences = ([Label(f"{a} {sign} {b}") for a, b in pairs] for sign in "+-")
    return (
        *box,
        Table.of("middle_of_range", inputs, reach.centre),
        Table.of("half_range", inputs, reach.half_range),
        Table.of("sum_low", sums, reach.sums[0] - MARGIN),
        Table.of("sum_high", sums, reach.sums[1] + MARGIN),
        Table.of("difference_low", differences, reach.differences[0] - MARGIN),
        Table.of("difference_high", differences, reach.differences[1] + MARGIN),
    )


def operations(compensation: Compensation) -> Operations:
    """What it costs, with the slope that goes on outside."""
    k = len(compensation.inputs)
    slope = Operations(adds=2, multiplies=1)
    if compensation.reach.sums is None:
        return slope + Operations(compares=4 * k)
    pairs = k * (k - 1) // 2
    return slope + Operations(adds=3 * k + 2 * pairs, multiplies=k, divides=k + 2 * pairs, compares=5 * k + 6 * pairs)
