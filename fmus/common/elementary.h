/* Elementary functions with the same bits on every platform; those of the C libraries differ in the last digit. */
#ifndef EIGHTPOST_ELEMENTARY_H
#define EIGHTPOST_ELEMENTARY_H

#include "names.h"

double exponential(double x);
double exponential_minus_1(double x);
double hyperbolic_tangent(double x);
double logarithm(double x); /* of a normal positive number */
void sine_and_cosine(double x, double *sine, double *cosine);

static inline int is_finite(double x)
{
    return x - x == 0.0;
}

#endif
