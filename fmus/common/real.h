/* A number of a model: one double in an FMU; in a library that runs many setups at once (fmus/machine), one for each of them.
 * Files that use these names instead of double and ?: compile as both, with the same operations in the same order. */
#ifndef EIGHTPOST_REAL_H
#define EIGHTPOST_REAL_H

#ifdef EIGHTPOST_LANES
#include "lanes.h"
#else

typedef double real;
typedef int truth;

/* The initializer of an array of zeros. */
#define ZERO 0.0

/* Of functions that are better compiled apart for several setups at once. */
#define APART inline

/* A macro, so that only one of both is computed. */
#define either(condition, a, b) ((condition) ? (a) : (b))

static inline real uniform(double value)
{
    return value;
}

static inline real size_of(real value)
{
    return either(value < 0.0, -value, value);
}

/* Whether a condition is true in any setup, or in every one. */
static inline int in_any(truth condition)
{
    return condition;
}

static inline int in_every(truth condition)
{
    return condition;
}

/* Whether one of two conditions is true, in each setup. */
static inline truth one_of(truth a, truth b)
{
    return a || b;
}

/* Whether both are. */
static inline truth both_of(truth a, truth b)
{
    return a && b;
}

static inline truth is_false(truth condition)
{
    return !condition;
}

#endif
#endif
