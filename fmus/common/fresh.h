/* Read numbers that were written a moment ago, one by one. A processor forwards a store to a load of the same size, but delays a
 * wider load until the stores are done. A compiler would load several numbers at once, and a shock's step would then take half as
 * long again. */
#ifndef EIGHTPOST_FRESH_H
#define EIGHTPOST_FRESH_H

static inline double fresh(const double *number)
{
    return *(const volatile double *)number;
}

static inline void copy_fresh(double *to, const double *from, int count)
{
    for (int k = 0; k < count; k++) {
        to[k] = fresh(from + k);
    }
}

#endif
