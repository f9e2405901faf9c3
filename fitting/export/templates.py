"""The text of exported C files; @WORDS@ are filled in by `fitting.export.c99`."""

_ABOUT = """\
/* Temperature compensation: @ABOUT@ (@KIND@)
 *
 * Inputs, with the range of the training data:
@INPUT_LIST@
 * Output: @OUTPUT@ in @UNIT@.
@HOW@ *
 * Trained on @ROWS@ rows; SHA-256 of them (little-endian float64, inputs row by row, then the target):
 *   @HASH@
 * Written by @WRITTEN@. Fit and export again instead of changing this file.
 */
"""

HEADER = (
    _ABOUT
    + """\
#ifndef @UPPER@_H
#define @UPPER@_H

#ifdef __cplusplus
extern "C" {
#endif

enum { @NAME@_INPUTS = @INPUTS@ };
@STATE_DECLARED@
/* The output for one row. Outside the training range the row is held at its edge, and a rate goes on from there along a
 * straight line; *guarded (may be a null pointer) then becomes 1, else 0. A row with a NaN gives NaN, guarded. */
@REAL@ @NAME@(@STATE@const @REAL@ x[@NAME@_INPUTS], int *guarded);
@COMPENSATE_DECLARED@
/* 0 if tables and arithmetic are as they were when this file was written; -1 if a table was changed; otherwise the
 * number, from 1, of the first test row that came out wrong. Not there if compiled with FOGBENCH_NO_SELFTEST. */
int @NAME@_selftest(void);

#ifdef __cplusplus
}
#endif

#endif
"""
)

SOURCE = (
    _ABOUT
    + """\
#include "@NAME@.h"

#include <math.h>
#include <stddef.h>

#ifdef __FAST_MATH__
#error "compile without -ffast-math: guard and self-test need NaN and the order of additions"
#endif

typedef @REAL@ real;
#define REAL_EXP exp@SUFFIX@
#define REAL_TANH tanh@SUFFIX@
#define REAL_SQRT sqrt@SUFFIX@
#define REAL_FREXP frexp@SUFFIX@
#define REAL_FABS fabs@SUFFIX@

enum { INPUTS = @INPUTS@@SIZES@ };

@TABLES@

@GUARD@
static real model(const real *x)
{
@BODY@
}

@EVALUATE@@COMPENSATE@@SELFTEST@"""
)

# Of models of an error.
COMPENSATE_DECLARED = """
/* The compensated rate in deg/s: rate_dps, what the gyro gave, less the error. */
@REAL@ @NAME@_compensate(@STATE@const @REAL@ x[@NAME@_INPUTS], @REAL@ rate_dps, int *guarded);
"""
COMPENSATE = """
@REAL@ @NAME@_compensate(@STATE@const @REAL@ x[INPUTS], @REAL@ rate_dps, int *guarded)
{
    return rate_dps - @NAME@(@PASS@x, guarded)@FACTOR@;
}
"""

EVALUATE = """\
@REAL@ @NAME@(const @REAL@ x[INPUTS], int *guarded)
{
    real held[INPUTS], y;
    const int outside = bring_inside(x, held);
    int i;
    y = model(held);
@OUTSIDE@    for (i = 0; i < INPUTS; ++i)
        if (x[i] != x[i])
            y = x[i];
    if (guarded != NULL)
        *guarded = outside;
    return y;
}
"""

SELFTEST = """
#ifndef FOGBENCH_NO_SELFTEST

enum { TESTS = @TESTS@ };

@TEST_DATA@

/* Fletcher's checksum over exponents and mantissas in two halves: exact, whatever the byte order. */
static void add(unsigned long sums[2], const real *table, int size)
{
    long words[3];
    int i, j, exponent;
    for (i = 0; i < size; ++i) {
        const real mantissa = REAL_FREXP(table[i], &exponent) * (real)67108864;
        words[0] = exponent;
        words[1] = (long)mantissa;
        words[2] = (long)((mantissa - (real)words[1]) * (real)134217728);
        for (j = 0; j < 3; ++j) {
            sums[0] = (sums[0] + (unsigned long)words[j]) & 0xFFFFFFFFUL;
            sums[1] = (sums[1] + sums[0]) & 0xFFFFFFFFUL;
        }
    }
}

@SELFTEST_BODY@
int @NAME@_selftest(void)
{
    unsigned long sums[2] = {0UL, 0UL};
@CHECKS@
    if (sums[0] != @FIRST@UL || sums[1] != @SECOND@UL)
        return -1;
    return vector_failed();
}

#endif

#ifdef FOGBENCH_SELFTEST_MAIN
#include <stdio.h>

int main(void)
{
    const int failed = @NAME@_selftest();
    printf("@NAME@: %s (%d)\\n", failed ? "FAILED" : "ok", failed);
    return failed ? 1 : 0;
}
#endif
"""

# Number of the first row that comes out wrong, from 1.
SELFTEST_BODY = """\
static int vector_failed(void)
{
    real row[INPUTS], y;
    int i, guarded;
    for (i = 0; i < TESTS; ++i) {
        y = @NAME@(test_row + i * INPUTS, &guarded);
        if (!(REAL_FABS(y - test_expected[i]) <= test_tolerance[i]) || guarded != test_outside[i])
            return i + 1;
    }
    for (i = 0; i < INPUTS; ++i)
        row[i] = test_row[i];
    row[0] = (real)NAN;
    y = @NAME@(row, &guarded);
    return y == y || !guarded ? TESTS + 1 : 0;
}
"""
