/* exp, expm1, tanh, log, sin and cos by argument reduction and Taylor series, to a few roundings. */
#include "elementary.h"

#include <stdint.h>
#include <string.h>

/* ln 2 and pi/2 as sums of parts; a part times a whole number below 2^20 is exact. */
static const double LN2_HIGH = 0x1.62e42fee00000p-1, LN2_LOW = 0x1.a39ef35793c76p-33;
static const double INVERSE_LN2 = 0x1.71547652b82fep0;
static const double QUARTER_HIGH = 0x1.921fb54400000p0, QUARTER_MIDDLE = 0x1.0b4611a600000p-34,
                    QUARTER_LOW = 0x1.3198a2e037073p-69;
static const double INVERSE_QUARTER = 0x1.45f306dc9c883p-1, TURN = 0x1.921fb54442d18p2;

/* 1/k!, k = 2 .. 15: coefficients of (e^r - 1 - r) / r^2. */
static const double EXPONENTIAL[] = {
    1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0, 1.0 / 362880.0,
    1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0, 1.0 / 87178291200.0, 1.0 / 1307674368000.0,
};
enum { EXPONENTIAL_TERMS = sizeof EXPONENTIAL / sizeof EXPONENTIAL[0], CIRCULAR_TERMS = 9, LOGARITHM_TERMS = 10 };

/* 2^k for -1022 <= k <= 1023. */
static double power_of_two(int k)
{
    uint64_t bits = (uint64_t)(k + 1023) << 52;
    double power;
    memcpy(&power, &bits, sizeof power);
    return power;
}

/* Nearest whole number for |x| < 2^62; NaN and infinity must be excluded before. */
static double nearest(double x)
{
    return (double)(int64_t)(x < 0.0 ? x - 0.5 : x + 0.5);
}

/* e^r - 1 for |r| <= ln(2)/2. Even and odd terms are summed separately: two short chains are faster than a long one. */
static double series_minus_1(double r)
{
    const double square = r * r;
    double even = EXPONENTIAL[EXPONENTIAL_TERMS - 2], odd = EXPONENTIAL[EXPONENTIAL_TERMS - 1];
    for (int k = EXPONENTIAL_TERMS - 4; k >= 0; k -= 2) {
        even = even * square + EXPONENTIAL[k];
        odd = odd * square + EXPONENTIAL[k + 1];
    }
    return r + square * (even + r * odd);
}

/* x = k ln 2 + r: returns e^r - 1. */
static double reduced(double x, int *k)
{
    const double whole = nearest(x * INVERSE_LN2);
    *k = (int)whole;
    return series_minus_1((x - whole * LN2_HIGH) - whole * LN2_LOW);
}

double exponential(double x)
{
    int k;
    if (!(x <= 709.0)) { /* 2^1024 overflows; for a large argument or NaN the result is infinity or NaN */
        return x - x == 0.0 && x < 709.78 ? exponential(x - 1.0) * 0x1.5bf0a8b145769p1 : x * 1e308 * 10.0;
    }
    if (x < -700.0) { /* below 1e-304, which is negligible here */
        return 0.0;
    }
    const double rest = reduced(x, &k);
    return power_of_two(k) * (1.0 + rest);
}

double exponential_minus_1(double x)
{
    int k;
    if (!(x <= 700.0 && x >= -40.0)) {
        return exponential(x) - 1.0;
    }
    const double rest = reduced(x, &k);
    return power_of_two(k) * rest + (power_of_two(k) - 1.0);
}

double hyperbolic_tangent(double x)
{
    const double size = x < 0.0 ? -x : x;
    double result = 1.0;
    if (!(size >= 22.0)) {
        const double rise = exponential_minus_1(2.0 * size);
        result = rise / (rise + 2.0);
    }
    return x < 0.0 ? -result : result;
}

/* x = 2^k m with m from sqrt(1/2) to sqrt(2): k ln 2 + 2 artanh s, s = (m - 1) / (m + 1). */
double logarithm(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    int k = (int)(bits >> 52) - 1023;
    double m = x * power_of_two(k < 1023 ? -k : -1022) * (k < 1023 ? 1.0 : 0.5);
    if (m > 0x1.6a09e667f3bcdp0) {
        m *= 0.5;
        k++;
    }
    const double s = (m - 1.0) / (m + 1.0), square = s * s;
    double sum = 0.0;
    for (int term = LOGARITHM_TERMS; term >= 1; term--) {
        sum = square * (1.0 / (double)(2 * term + 1) + sum);
    }
    return (double)k * LN2_HIGH + ((double)k * LN2_LOW + (2.0 * s + 2.0 * s * sum));
}

/* sin r and cos r for |r| <= pi/4. */
static void circular_series(double r, double *sine, double *cosine)
{
    const double square = r * r;
    double s = 1.0, c = 1.0;
    for (int k = CIRCULAR_TERMS; k >= 1; k--) {
        s = 1.0 - square * s / (double)(2 * k * (2 * k + 1));
        c = 1.0 - square * c / (double)(2 * k * (2 * k - 1));
    }
    *sine = r * s;
    *cosine = c;
}

void sine_and_cosine(double x, double *sine, double *cosine)
{
    double s, c;
    if (x != x) {
        *sine = *cosine = x;
        return;
    }
    if (x > 1e6 || x < -1e6) { /* the rounding of the angle itself limits the accuracy */
        if (!(x < 1e15 && x > -1e15)) {
            x = 0.0;
        }
        x -= nearest(x / TURN) * TURN;
    }
    const double whole = nearest(x * INVERSE_QUARTER);
    circular_series(((x - whole * QUARTER_HIGH) - whole * QUARTER_MIDDLE) - whole * QUARTER_LOW, &s, &c);
    switch ((int)((int64_t)whole & 3)) {
    case 0: *sine = s; *cosine = c; break;
    case 1: *sine = c; *cosine = -s; break;
    case 2: *sine = -s; *cosine = -c; break;
    default: *sine = -c; *cosine = s; break;
    }
}
