/* What the drive does to a car, once for all setups. */
#include <string.h>

#include "machine.h"

/* sum += a b of complex numbers. */
static inline void add_product(const double *a, const double *b, double *sum)
{
    sum[0] += a[0] * b[0] - a[1] * b[1];
    sum[1] += a[0] * b[1] + a[1] * b[0];
}

static void find_load(const Driven *d, int64_t point, double *load)
{
    const double *inputs = d->inputs + point * d->input_count;
    memset(load, 0, STATES * sizeof *load);
    for (int64_t j = 0; j < d->input_count; j++) {
        for (int i = 0; i < STATES; i++) {
            load[i] += d->into[j * STATES + i] * inputs[j];
        }
    }
}

static void read_rows(const Driven *d, const double *z, double *found)
{
    for (int64_t k = 0; k < d->output_count; k++) {
        double sum = 0.0;
        for (int i = 0; i < STATES; i++) {
            sum += d->rows[k * STATES + i] * z[i];
        }
        found[k] = sum;
    }
}

/* Outputs (wanted_count rows) of the car's complex modes from the states z at the first point, while the inputs are linear between
 * points. */
EXPORTED void drive_car(const Driven *d, const double *start, double *found)
{
    double z[STATES], load[2][STATES];
    int64_t row = 0;
    memcpy(z, start, sizeof z);
    find_load(d, 0, load[0]);
    for (int64_t n = 0; row < d->wanted_count; n++) {
        if (d->wanted[row] == n) {
            read_rows(d, z, found + row++ * d->output_count);
        }
        if (n == d->intervals) {
            break;
        }
        const double *before = load[n % 2];
        double *after = load[(n + 1) % 2];
        const int64_t kind = (int64_t)d->kinds[n] * STATES;
        find_load(d, n + 1, after);
        for (int i = 0; i < STATES; i += 2) {
            double next[2] = {0.0, 0.0};
            add_product(d->turn + kind + i, z + i, next);
            add_product(d->first + kind + i, before + i, next);
            add_product(d->last + kind + i, after + i, next);
            memcpy(z + i, next, sizeof next);
        }
    }
}
