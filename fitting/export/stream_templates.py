"""The text of exported C files that keep a state; @WORDS@ as in `fitting.export.templates`."""

HOW = """\
 * It looks at the history of the temperatures: call it for every row of a record, in order, every @PERIOD@ s.
"""

STATE = """
/* What is kept of a record; begin each with @NAME@_start. Of a record the first @NEEDED@ rows, which tell how it began,
 * give NaN, guarded; so does a row with a NaN, which counts as a row without change. */
typedef struct {
    @REAL@ past[@SLOTS@];
    @REAL@ lag[@LAG_SLOTS@];
    long rows;
} @NAME@_state;

void @NAME@_start(@NAME@_state *state);
"""

EVALUATE = """\
/* Lags of the mean temperature, one row on. */
static void go_on(@NAME@_state *state, real change)
{
    int j;
    for (j = 0; j < LAGS; ++j)
        state->lag[j] += lag_filter[3 * j + 1] * change - lag_filter[3 * j] * state->lag[j];
}

/* As if the temperature had always changed by `step` a row before the first of `count` rows. */
static void begin(@NAME@_state *state, real step, int count)
{
    int i, j;
    for (j = 0; j < LAGS; ++j)
        state->lag[j] = step * lag_filter[3 * j + 2];
    go_on(state, step);
    for (i = 1; i < count; ++i)
        go_on(state, state->past[i] - state->past[i - 1]);
}

/* Slope a row of the least-squares line through the first WINDOW + 1 rows. */
static real first_step(const @NAME@_state *state)
{
    real up = (real)0, squares = (real)0;
    int i;
    for (i = 0; i <= WINDOW; ++i) {
        const real at = (real)i - (real)0.5 * (real)WINDOW;
        up += at * (state->past[i] - state->past[0]);
        squares += at * at;
    }
    return up / squares;
}

static real missing(int *guarded)
{
    if (guarded != NULL)
        *guarded = 1;
    return (real)NAN;
}

void @NAME@_start(@NAME@_state *state)
{
    int i;
    for (i = 0; i <= WINDOW; ++i)
        state->past[i] = (real)0;
    for (i = 0; i < LAGS; ++i)
        state->lag[i] = (real)0;
    state->rows = 0;
}

@REAL@ @NAME@(@STATE@const @REAL@ x[INPUTS], int *guarded)
{
    const int waits = @WAITS@;
    real held[INPUTS], feature[OUTPUTS], now = (real)0;
    const int outside = bring_inside(x, held);
    const int slot = (int)(state->rows % (WINDOW + 1)), last = (slot + WINDOW) % (WINDOW + 1);
    int i, lost = 0;
    for (i = 0; i < INPUTS; ++i) {
        lost |= x[i] != x[i];
        now += held[i];
    }
    if (lost && state->rows == 0)
        return missing(guarded);
    now = lost ? state->past[last] : now / (real)INPUTS;
    if (!waits && state->rows == 0) {
        for (i = 0; i <= WINDOW; ++i)
            state->past[i] = now;
        begin(state, (real)0, 1);
    }
    const real change = now - state->past[last];
    state->past[slot] = now;
    if (waits && state->rows == WINDOW)
        begin(state, first_step(state), WINDOW + 1);
    else if (state->rows > 0 && (!waits || state->rows > WINDOW))
        go_on(state, change);
    state->rows = state->rows < 2L * WINDOW + 1L ? state->rows + 1 : state->rows - WINDOW;
    if (lost || (waits && state->rows <= WINDOW))
        return missing(guarded);
    feature[0] = now;
    for (i = 1; i < INPUTS; ++i)
        feature[i] = held[i] - held[i - 1];
    feature[INPUTS] = (now - state->past[(slot + 1) % (WINDOW + 1)]) * (real)@SLOPE_FACTOR@;
    for (i = 0; i < LAGS; ++i)
        feature[INPUTS + 1 + i] = state->lag[i];
    if (guarded != NULL)
        *guarded = outside;
    return model(feature);
}
"""

SELFTEST_BODY = """\
static int vector_failed(void)
{
    static @NAME@_state state;
    real row[INPUTS], y;
    int i, k, guarded, test = 0;
    @NAME@_start(&state);
    for (i = 0; test < TESTS; ++i) {
        for (k = 0; k < INPUTS; ++k)
            row[k] = test_first[k] + test_step[k] * (real)(i < TEST_TURN ? i : 2 * TEST_TURN - i);
        y = @NAME@(&state, row, &guarded);
        if (i == WINDOW + (test + 1) * TEST_STRIDE) {
            if (!(REAL_FABS(y - test_expected[test]) <= test_tolerance[test]) || guarded != test_outside[test])
                return test + 1;
            ++test;
        }
    }
    row[0] = (real)NAN;
    y = @NAME@(&state, row, &guarded);
    return y == y || !guarded ? TESTS + 1 : 0;
}
"""
