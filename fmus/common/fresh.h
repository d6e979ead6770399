/* Numbers that were written a moment ago, read one by one. A processor hands what it has just stored on to a load of the same
 * size, and lets a wider one wait until the stores are done; a compiler would load several numbers at once, and a shock's step
 * then takes half as long again. */
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
