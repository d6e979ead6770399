/* The band-pass of cosim/study/statistics.py for several setups at once: second-order sections, forward and backward. */
#include "lanes.h"

#include "machine.h"

enum { MOST_SECTIONS = 16 };

/* Filters in place, like scipy's sosfilt with an initial state: from the first row to the last, or back. */
static void filter_once(const Filter *f, real *rows, int64_t count, int64_t step)
{
    real z[MOST_SECTIONS][2];
    const real *first = step > 0 ? rows : rows + count - 1;
    for (int s = 0; s < f->sections; s++) {
        z[s][0] = f->rest[2 * s] * *first;
        z[s][1] = f->rest[2 * s + 1] * *first;
    }
    real *row = step > 0 ? rows : rows + count - 1;
    for (int64_t k = 0; k < count; k++, row += step) {
        real x = *row;
        for (int s = 0; s < f->sections; s++) {
            const double *c = f->rows + 6 * s; /* b0, b1, b2, 1, a1, a2 */
            const real y = c[0] * x + z[s][0];
            z[s][0] = c[1] * x - c[4] * y + z[s][1];
            z[s][1] = c[2] * x - c[5] * y;
            x = y;
        }
        *row = x;
    }
}

/* Filters one column of a batch's series into `space`, which has room for `pad` rows before and after it. */
EXPORTED void filter_series(const Filter *f, const double *series, int64_t columns, int64_t column, int64_t count, double *space)
{
    const real *from = (const real *)(const void *)series + column;
    real *rows = (real *)(void *)space;
    const int64_t pad = f->pad;
    for (int64_t k = 0; k < count; k++) {
        rows[pad + k] = from[k * columns];
    }
    for (int64_t k = 1; k <= pad; k++) {
        rows[pad - k] = 2.0 * rows[pad] - rows[pad + k];
        rows[pad + count - 1 + k] = 2.0 * rows[pad + count - 1] - rows[pad + count - 1 - k];
    }
    filter_once(f, rows, count + 2 * pad, 1);
    filter_once(f, rows, count + 2 * pad, -1);
}
