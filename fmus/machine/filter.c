/* The band-pass of cosim/study/statistics.py for several setups at once: second-order sections, forward and backward. */
#include "lanes.h"

#include "machine.h"

/* Sections that are filtered together: their states stay in registers. */
enum { TOGETHER = 4 };

/* Filters rows in place with some sections; `start` is the first number before any section. */
static inline WITHIN void filter_part(const Filter *f, int64_t first, int sections, Sum start, Sum *row, int64_t count, int64_t step)
{
    const double *c = f->rows + 6 * first, *rest = f->rest + 2 * first; /* b0, b1, b2, 1, a1, a2 of each */
    Sum z[TOGETHER][2];
    for (int s = 0; s < sections; s++) {
        z[s][0] = rest[2 * s] * start;
        z[s][1] = rest[2 * s + 1] * start;
    }
    for (int64_t k = 0; k < count; k++, row += step) {
        Sum x = *row;
        UNROLLED
        for (int s = 0; s < sections; s++) {
            const Sum y = c[6 * s] * x + z[s][0];
            z[s][0] = c[6 * s + 1] * x - c[6 * s + 4] * y + z[s][1];
            z[s][1] = c[6 * s + 2] * x - c[6 * s + 5] * y;
            x = y;
        }
        *row = x;
    }
}

/* Filters in place, like scipy's sosfilt with an initial state: `step` is 1, or -1 from the last row. */
static void filter_once(const Filter *f, Sum *first_row, int64_t count, int64_t step)
{
    const Sum start = *first_row;
    int64_t s = 0;
    for (; s + TOGETHER <= f->sections; s += TOGETHER) {
        filter_part(f, s, TOGETHER, start, first_row, count, step);
    }
    for (; s < f->sections; s++) {
        filter_part(f, s, 1, start, first_row, count, step);
    }
}

/* Filters one column of a batch's series, in double precision. `space` has room for it and for `pad` rows before and after it; the
 * result is at its start, in the precision of the series. */
EXPORTED void filter_series(const Filter *f, const number *series, int64_t columns, int64_t column, int64_t count, double *space)
{
    const real *from = (const real *)(const void *)series + column;
    Sum *rows = (Sum *)(void *)space;
    const int64_t pad = f->pad;
    for (int64_t k = 0; k < count; k++) {
        rows[pad + k] = __builtin_convertvector(from[k * columns], Sum);
    }
    for (int64_t k = 1; k <= pad; k++) {
        rows[pad - k] = 2.0 * rows[pad] - rows[pad + k];
        rows[pad + count - 1 + k] = 2.0 * rows[pad + count - 1] - rows[pad + count - 1 - k];
    }
    filter_once(f, rows, count + 2 * pad, 1);
    filter_once(f, rows + count + 2 * pad - 1, count + 2 * pad, -1);
    for (int64_t k = 0; k < count; k++) {
        ((real *)(void *)space)[k] = __builtin_convertvector(rows[pad + k], real);
    }
}
