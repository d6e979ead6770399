/* e^x, phi1(x) = (e^x - 1) / x and phi2(x) = (phi1(x) - 1) / x of several modes at once. */
#ifndef EIGHTPOST_PHI_H
#define EIGHTPOST_PHI_H

#include "elementary.h"
#include "vehicle_data.h"

/* 1 / (k + 2)!: phi2(x) = 1/2! + x/3! + x^2/4! + ... */
static const double PHI2[] = {
    1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0, 1.0 / 362880.0,
    1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0, 1.0 / 87178291200.0, 1.0 / 1307674368000.0,
};
enum { SERIES_TERMS = sizeof PHI2 / sizeof PHI2[0] };

/* Complex numbers of several modes: every operation applies to all modes, so that a compiler can use vector instructions. */
typedef struct {
    double re[LANES], im[LANES];
} Lanes;

typedef struct {
    Lanes e, phi1, phi2;
} Exponentials;

static Lanes product(const Lanes *a, const Lanes *b)
{
    Lanes c;
    for (int i = 0; i < LANES; i++) {
        c.re[i] = a->re[i] * b->re[i] - a->im[i] * b->im[i];
        c.im[i] = a->re[i] * b->im[i] + a->im[i] * b->re[i];
    }
    return c;
}

static Lanes plus(const Lanes *a, double number)
{
    Lanes c = *a;
    for (int i = 0; i < LANES; i++) {
        c.re[i] += number;
    }
    return c;
}

static Lanes weighted(const Lanes *a, double first, const Lanes *b, double second)
{
    Lanes c;
    for (int i = 0; i < LANES; i++) {
        c.re[i] = first * a->re[i] + second * b->re[i];
        c.im[i] = first * a->im[i] + second * b->im[i];
    }
    return c;
}

/* phi2 by its series, for |x| <= 1/2: division by the quadratic with the roots x and its conjugate, with two real products per term
 * (Knuth, The Art of Computer Programming 2, 4.6.4, (3)). */
static Lanes phi2_series(const Lanes *x)
{
    Lanes sum;
    double twice[LANES], square[LANES], first[LANES], second[LANES], next[LANES];
    for (int i = 0; i < LANES; i++) {
        twice[i] = 2.0 * x->re[i];
        square[i] = x->re[i] * x->re[i] + x->im[i] * x->im[i];
        first[i] = PHI2[SERIES_TERMS - 1];
        second[i] = 0.0;
    }
    for (int k = SERIES_TERMS - 2; k >= 1; k--) {
        for (int i = 0; i < LANES; i++) {
            next[i] = PHI2[k] + (twice[i] * first[i] - square[i] * second[i]);
            second[i] = first[i];
            first[i] = next[i];
        }
    }
    for (int i = 0; i < LANES; i++) {
        sum.re[i] = first[i] * x->re[i] + (PHI2[0] - square[i] * second[i]);
        sum.im[i] = first[i] * x->im[i];
    }
    return sum;
}

/* From x to 2 x: e^2x = (e^x)^2, phi1(2x) = phi1 (e^x + 1) / 2, phi2(2x) = (phi1^2 + 2 phi2) / 4. */
static Exponentials doubled(const Exponentials *a)
{
    const Lanes half = weighted(&a->phi1, 0.5, &a->phi1, 0.0), above = plus(&a->e, 1.0);
    const Lanes square = product(&half, &half);
    const Exponentials twice = {product(&a->e, &a->e), product(&half, &above), weighted(&square, 1.0, &a->phi2, 0.5)};
    return twice;
}

static Exponentials exponentials_by_series(const Lanes *x, int doublings)
{
    Exponentials a;
    a.phi2 = phi2_series(x);
    a.phi1 = product(x, &a.phi2);
    a.phi1 = plus(&a.phi1, 1.0);
    a.e = product(x, &a.phi1);
    a.e = plus(&a.e, 1.0);
    for (int k = 0; k < doublings; k++) {
        a = doubled(&a);
    }
    return a;
}

/* (a - 1) / x, for x that is not small. */
static Lanes difference_quotient(const Lanes *a, const Lanes *x)
{
    Lanes inverse;
    const Lanes rise = plus(a, -1.0);
    for (int i = 0; i < LANES; i++) {
        const double square = x->re[i] * x->re[i] + x->im[i] * x->im[i];
        inverse.re[i] = x->re[i] / square;
        inverse.im[i] = -x->im[i] / square;
    }
    return product(&rise, &inverse);
}

/* For modes of which one has an exponent so large that its series would need many doublings. */
static Exponentials exponentials_in_closed_form(const Lanes *x)
{
    Exponentials a = exponentials_by_series(x, 0), large;
    for (int i = 0; i < LANES; i++) {
        const double growth = exponential(x->re[i]);
        sine_and_cosine(x->im[i], &large.e.im[i], &large.e.re[i]);
        large.e.re[i] *= growth;
        large.e.im[i] *= growth;
    }
    large.phi1 = difference_quotient(&large.e, x);
    large.phi2 = difference_quotient(&large.phi1, x);
    for (int i = 0; i < LANES; i++) {
        if (x->re[i] * x->re[i] + x->im[i] * x->im[i] > 0.25) {
            a.e.re[i] = large.e.re[i];
            a.e.im[i] = large.e.im[i];
            a.phi1.re[i] = large.phi1.re[i];
            a.phi1.im[i] = large.phi1.im[i];
            a.phi2.re[i] = large.phi2.re[i];
            a.phi2.im[i] = large.phi2.im[i];
        }
    }
    return a;
}

#endif
