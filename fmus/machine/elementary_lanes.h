/* exp, expm1, tanh and log of several setups at once, for the arguments of friction forces and laws, about as in common/elementary.c.
 * It replaces common/elementary.h where numbers are those of lanes. */
#ifndef EIGHTPOST_ELEMENTARY_LANES_H
#define EIGHTPOST_ELEMENTARY_LANES_H
#define EIGHTPOST_ELEMENTARY_H

#include "real.h"

/* High bits of ln 2, of which small multiples are exact, and the rest. */
static const number LN2_HIGH = 0x1.62e4p-1, LN2_LOW = 0x1.62e42fefa39efp-1 - 0x1.62e4p-1, INVERSE_LN2 = 0x1.71547652b82fep0;
/* Bits of the fraction of a number, bias of its exponent, and a power of e that it has. */
enum { FRACTION = IS_DOUBLE ? 52 : 23, BIAS = IS_DOUBLE ? 1023 : 127, LARGEST_POWER = IS_DOUBLE ? 700 : 86 };

/* 1/k!, k = 2 .. 15. */
static const number EXPONENTIAL[] = {
    1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0, 1.0 / 362880.0,
    1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0, 1.0 / 87178291200.0, 1.0 / 1307674368000.0,
};
enum { EXPONENTIAL_TERMS = IS_DOUBLE ? 14 : 8, LOGARITHM_TERMS = 10 };

/* 2^k, and e^r - 1 of x = k ln 2 + r, for |x| <= LARGEST_POWER. */
typedef struct {
    real power, rest;
} Reduced;

static inline Reduced reduced(real x)
{
    const real scaled = x * INVERSE_LN2;
    const Short k = __builtin_convertvector(either(scaled < 0.0, scaled - 0.5, scaled + 0.5), Short);
    const real whole = __builtin_convertvector(k, real);
    const Index bits = (__builtin_convertvector(k, Index) + BIAS) << FRACTION;
    const real r = (x - whole * LN2_HIGH) - whole * LN2_LOW, square = r * r;
    real even = uniform(EXPONENTIAL[EXPONENTIAL_TERMS - 2]), odd = uniform(EXPONENTIAL[EXPONENTIAL_TERMS - 1]);
    for (int term = EXPONENTIAL_TERMS - 4; term >= 0; term -= 2) {
        even = even * square + EXPONENTIAL[term];
        odd = odd * square + EXPONENTIAL[term + 1];
    }
    const Reduced found = {(real)bits, r + square * (even + r * odd)};
    return found;
}

/* e^x; 0 below the smallest power. Arguments above the largest one do not occur: friction decays. */
static inline real exponential(real x)
{
    const truth is_small = x < (number)-LARGEST_POWER;
    const Reduced found = reduced(either(is_small, uniform(0.0), x));
    return either(is_small, uniform(0.0), found.power * (1.0 + found.rest));
}

/* e^x - 1 for x up to the largest power. */
static inline real exponential_minus_1(real x)
{
    const truth is_small = x < (number)-LARGEST_POWER;
    const Reduced found = reduced(either(is_small, uniform(0.0), x));
    return either(is_small, uniform(-1.0), found.power * found.rest + (found.power - 1.0));
}

static inline real hyperbolic_tangent(real x)
{
    const real fall = exponential_minus_1(-(2.0 * size_of(x))), result = -fall / (fall + 2.0);
    return either(x < 0.0, -result, result);
}

/* ln x for positive numbers far from underflow and overflow. */
static inline real logarithm(real x)
{
    const Index exponent = ((Index)x >> FRACTION) - BIAS;
    const real scaled = x * (real)((BIAS - exponent) << FRACTION);
    const truth is_large = scaled > (number)0x1.6a09e667f3bcdp0;
    const real m = either(is_large, scaled * 0.5, scaled), s = (m - 1.0) / (m + 1.0), square = s * s;
    const real k = __builtin_convertvector(__builtin_convertvector(exponent - is_large, Short), real); /* is_large is 0 or -1 */
    real sum = uniform(0.0);
    for (int term = LOGARITHM_TERMS; term >= 1; term--) {
        sum = square * ((number)(1.0 / (2 * term + 1)) + sum);
    }
    return k * LN2_HIGH + (k * LN2_LOW + (2.0 * s + 2.0 * s * sum));
}

#endif
