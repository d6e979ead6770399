/* The data of a run of several setups, and the sums over its steps. */
#ifndef EIGHTPOST_MARCH_H
#define EIGHTPOST_MARCH_H

#include "machine.h"
#include "port.h"

enum { MOST_CHANNELS = 256, MOST_LIMITS = 8, RECORDS = 16 };

/* The sums over steps and records, in the order of Sums. */
typedef struct {
    real transferred[CORNERS], residual[CORNERS], defect[2 * CORNERS], total[2 * CORNERS], squares[2 * CORNERS];
    real beyond[CORNERS], watched[MOST_LIMITS];
} Totals;

typedef struct {
    const Run *run;
    Kinds kinds;
    real states[STATES + FORCES]; /* of the car without the last forces beyond its dampers, and these; the drive's part is in Run */
    Point at[CORNERS]; /* of the shocks at the step's start */
    Cubics cubics[CORNERS]; /* there, which only the law Hysteresis needs */
    real travel[CORNERS], force[CORNERS]; /* at the step's start [m], F [N] */
    real earlier[2][CORNERS], before[CORNERS]; /* velocities at the starts of the two steps before, and F at that of the last one */
    truth alive;
    int64_t record;
    Totals totals;
    real seen[RECORDS * MOST_CHANNELS]; /* channels at the last records, which are summed together */
    Port ports[CORNERS]; /* it and the channels are not cleared */
} March;

/* A number and a row of a matrix times numbers, in two sums that do not wait for each other. */
static inline WITHIN real with_row(real first, const number *row, const real *numbers, int count)
{
    real second = row[count / 2] * numbers[count / 2];
    UNROLLED
    for (int i = 0; i < count / 2; i++) {
        first += row[i] * numbers[i];
    }
    UNROLLED
    for (int i = count / 2 + 1; i < count; i++) {
        second += row[i] * numbers[i];
    }
    return first + second;
}

#endif
