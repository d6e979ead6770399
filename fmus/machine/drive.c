/* What a drive does to the car without forces beyond its dampers: once for all setups. */
#include <stdint.h>

#include "machine.h"

/* z_(n+1) = factor z_n + load_n for PAIRS complex numbers from z_0, in place of the loads. `factor` has a row for each kind of interval,
 * and `kinds` is that of each of `count` intervals. */
EXPORTED void accumulate(const double *first, const double *factors, const int32_t *kinds, int64_t count, double *loads)
{
    const double *z = first;
    for (int64_t n = 0; n < count; n++) {
        const double *e = factors + 2 * PAIRS * (int64_t)kinds[n];
        double *load = loads + 2 * PAIRS * n;
        for (int k = 0; k < PAIRS; k++) {
            const double x = z[2 * k], y = z[2 * k + 1];
            load[2 * k] += e[2 * k] * x - e[2 * k + 1] * y;
            load[2 * k + 1] += e[2 * k] * y + e[2 * k + 1] * x;
        }
        z = load;
    }
}
