/* Numbers of LANES setups at once, as the vector extensions of gcc and clang; see common/real.h. */
#ifndef EIGHTPOST_LANES_H
#define EIGHTPOST_LANES_H

#ifndef EIGHTPOST_LANES
#define EIGHTPOST_LANES /* real.h */
#endif

#include <stdint.h>
#include <string.h>

enum { SETUPS = 8 };

typedef double real __attribute__((vector_size(64)));
typedef int64_t truth __attribute__((vector_size(64)));
/* Indices, one for each setup. */
typedef int64_t Index __attribute__((vector_size(64)));

/* Sums of a block of a matrix's rows that are kept in registers. */
#ifdef __AVX512F__
#define TILE 8
#else
#define TILE 4
#endif

/* The initializer of an array of zeros. */
#define ZERO {0.0}

static inline real uniform(double value)
{
    return (real){value, value, value, value, value, value, value, value};
}

static inline real either(truth condition, real a, real b)
{
    return (real)(((truth)a & condition) | ((truth)b & ~condition));
}

static inline int in_any(truth condition)
{
    const truth c = condition;
    return ((c[0] | c[1]) | (c[2] | c[3]) | (c[4] | c[5]) | (c[6] | c[7])) != 0;
}

static inline int in_every(truth condition)
{
    return !in_any(~condition);
}

/* The number of each setup's index. */
static inline real chosen(const real *numbers, Index index)
{
    const double *first = (const double *)numbers;
    real found;
    for (int i = 0; i < SETUPS; i++) {
        found[i] = first[index[i] * SETUPS + i];
    }
    return found;
}

#endif
