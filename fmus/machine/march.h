/* The data of a run of several setups, and the sums over its steps. */
#ifndef EIGHTPOST_MARCH_H
#define EIGHTPOST_MARCH_H

#include "machine.h"
#include "port.h"

enum { MOST_CHANNELS = 256, MOST_LIMITS = 8 };

/* The sums over the steps, in the order of Sums. */
typedef struct {
    real transferred[CORNERS], residual[CORNERS], defect[2 * CORNERS], total[2 * CORNERS], squares[2 * CORNERS];
    real beyond[CORNERS], watched[MOST_LIMITS];
} Totals;

typedef struct {
    const Run *run;
    real states[STATES]; /* of the car by the forces beyond its dampers; the drive's part is in Run */
    Point at[NODES][CORNERS]; /* points of the shocks over a step */
    Cubics cubics[NODES][CORNERS]; /* and their cubics */
    real travel[CORNERS]; /* at the step's start [m] */
    real force[NODES][CORNERS], beyond[NODES][CORNERS]; /* F, and G = F - c v [N] */
    real earlier[2][CORNERS], before[CORNERS]; /* velocities at the starts of the two steps before, and F at that of the last one */
    real output[MOST_CHANNELS], seen[MOST_CHANNELS]; /* at the last record */
    truth alive;
    int64_t record;
    Totals totals;
    Port ports[CORNERS]; /* the last one: it is prepared and not cleared */
} March;

/* A row of the car's matrices times its states, in sums that do not wait for each other. */
static inline real row_times(const double *row, const real *states)
{
    real sum[4] = {{0.0}};
    for (int i = 0; i < STATES; i++) {
        sum[i % 4] += row[i] * states[i];
    }
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static inline real size_of_number(real x)
{
    return either(x < 0.0, -x, x);
}

#endif
