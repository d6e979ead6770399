/* The vehicle's modes as model.c and rates.c use them: b u, rows of C z. */
#ifndef EIGHTPOST_MODAL_H
#define EIGHTPOST_MODAL_H

#include <string.h>

#include "component.h"
#include "fresh.h"
#include "real.h"
#include "vehicle_data.h"

/* Real parts of all modes, then imaginary parts of the pairs, each padded to a multiple of LANES; the padding is zero and stays
 * so. */
typedef struct {
    real at[STATE_BLOCKS * BLOCK];
} Modal;

/* The last of the real states that are coupled with each other, if modes are nearly dependent; SIGMA and OMEGA are zero there. */
enum { FIRST_COUPLED = MODE_COUNT - COUPLED_COUNT };

/* Memory.state: z, the corresponding inputs including the forces of the ports, and the deflections of the bristles. Outputs are
 * computed when they are read. */
enum { REACHED = STATE_COUNT, BENT = STATE_COUNT + INPUTS };

/* Upper limit of any state and input, in any unit: far below an overflow of an output, a derivative or the next step. */
static const double LARGEST = 1e150;

/* The factors of one step. */
typedef struct {
    double h;
    double e_re[MODES], e_im[MODES]; /* e^(lambda h) */
    double first_re[MODES], first_im[MODES]; /* h (phi1 - phi2) */
    double second_re[MODES], second_im[MODES]; /* h phi2 */
    double coupled_e[COUPLED_CELLS], coupled_first[COUPLED_CELLS], coupled_second[COUPLED_CELLS]; /* by rows */
    double product[COUPLED_CELLS];
} Factors;

/* A row of a matrix of the coupled states times these. */
static inline real coupled_row(const double *row, const real *z)
{
    real sum = uniform(0.0);
    for (int c = 0; c < COUPLED_COUNT; c++) {
        sum += row[c] * z[FIRST_COUPLED + c];
    }
    return sum;
}

/* b u. B is stored in blocks of rows, column by column, so that a compiler keeps a block's sums in registers and adds in the same
 * order everywhere. Inputs that are zero are skipped. */
#ifndef EIGHTPOST_LANES
static inline void load(const real *u, Modal *w)
{
    int moving[INPUTS], count = 0;
    for (int c = 0; c < INPUTS; c++) {
        moving[count] = c;
        count += in_any(u[c] != 0.0);
    }
    for (int b = 0; b < STATE_BLOCKS; b++) {
        for (int first = 0; first < BLOCK; first += TILE) {
            real sum[TILE] = {ZERO};
            for (int k = 0; k < count; k++) {
                const real input = u[moving[k]];
                const double *column = &B[b][moving[k]][first];
                for (int r = 0; r < TILE; r++) {
                    sum[r] += column[r] * input;
                }
            }
            memcpy(&w->at[b * BLOCK + first], sum, sizeof sum);
        }
    }
}

/* Numbers of rows that are computed: with padding, so that a compiler uses vector instructions. */
enum { MODE_ROWS = MODES, PAIR_ROWS = PAIRS };
#else

/* Lanes need no padding. */
enum { MODE_ROWS = MODE_COUNT, PAIR_ROWS = PAIR_COUNT };

/* Rows `first` to `first` + `count` - 1 of b u; the products of the inputs from `own` on are given. */
static inline WITHIN void load_rows(const real *u, int own, double (*product)[STATE_BLOCKS * BLOCK], int first, int count,
                                    Modal *w)
{
    real sum[TILE] = {ZERO};
    for (int c = 0; c < own; c++) {
        for (int r = 0; r < count; r++) {
            sum[r] += B[(first + r) / BLOCK][c][(first + r) % BLOCK] * u[c];
        }
    }
    for (int c = own; c < INPUTS; c++) {
        for (int r = 0; r < count; r++) {
            sum[r] += product[c][first + r];
        }
    }
    memcpy(&w->at[first], sum, (size_t)count * sizeof *sum);
}

static inline int smaller_of(int a, int b)
{
    return a < b ? a : b;
}

/* The same; the last inputs, which are often equal in all setups, are then multiplied once. */
static inline void load(const real *u, Modal *w)
{
    ALIGNED double product[INPUTS][STATE_BLOCKS * BLOCK];
    int own = INPUTS; /* inputs before those that are equal */
    while (own > 0 && in_every(u[own - 1] == u[own - 1][0])) {
        own--;
    }
    for (int c = own; c < INPUTS; c++) {
        for (int k = 0; k < STATE_BLOCKS * BLOCK; k++) {
            product[c][k] = B[k / BLOCK][c][k % BLOCK] * u[c][0];
        }
    }
    for (int first = 0; first < MODE_ROWS; first += TILE) {
        load_rows(u, own, product, first, smaller_of(TILE, MODE_ROWS - first), w);
    }
    for (int first = 0; first < PAIR_ROWS; first += TILE) {
        load_rows(u, own, product, MODES + first, smaller_of(TILE, PAIR_ROWS - first), w);
    }
}
#endif

/* One row of C times z, as four sums. */
#ifndef EIGHTPOST_LANES
static inline real row_times(const double *row, const real *z)
{
    real sum[LANES] = {ZERO};
    for (int k = 0; k < STATE_COUNT; k += LANES) {
        for (int i = 0; i < LANES; i++) {
            sum[i] += row[k + i] * z[k + i];
        }
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]);
}
#else
/* The same; MODES is a multiple of LANES. Zero is added once, at the end, and makes the same bits: no result is -0. */
static inline real row_times(const double *row, const real *z)
{
    real sum[LANES] = {ZERO};
    for (int k = 0; k < MODE_ROWS; k++) {
        sum[k % LANES] = k < LANES ? row[k] * z[k] : sum[k % LANES] + row[k] * z[k];
    }
    for (int k = 0; k < PAIR_ROWS; k++) {
        sum[k % LANES] += row[MODES + k] * z[MODES + k];
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]) + 0.0;
}
#endif

#endif
