/* The data of a batch while it runs, and the sums over its steps. */
#ifndef EIGHTPOST_MARCH_H
#define EIGHTPOST_MARCH_H

#include "batch.h"
#include "lanes.h"
#include "port.h"
#include "vehicle.h"

/* Size of a signal at which the coupling has diverged, as in cosim/engine/march.py. */
static const double DIVERGED = 1e15;

enum { MOST_LIMITS = 8, MOST_CHANNELS = 256, MOST_QUANTITIES = 512 };

/* A coupled signal at the end of a step, at its start, and at the starts of the two before it; the older one only of forces. */
typedef struct {
    real now, ahead, past, older;
} Signal;

/* A coupled value over a step: at the start, its slope, its mean, and its end. */
typedef struct {
    real start, rate, mean, end;
} Line;

/* A coupling step, as in cosim/engine/plan.py. */
typedef struct {
    double size, per_second, line, newer, older, sag;
    int64_t first, last;
} Step;

/* The sums of a batch, in the order of Sums. */
typedef struct {
    real residual[CORNERS], transferred[CORNERS], beyond[CORNERS];
    real defect[2 * CORNERS], total[2 * CORNERS], squares[2 * CORNERS];
    real watched[MOST_LIMITS];
    double duration, settled;
} Totals;

typedef struct {
    const Run *run;
    int64_t row;
    double last[2], pace[2];
    truth alive;
    Vehicle vehicle;
    Signal velocity[CORNERS], displacement[CORNERS], force[CORNERS];
    Line velocity_line[CORNERS], force_line[CORNERS];
    real output[OUTPUTS], seen[MOST_CHANNELS]; /* outputs that a step needs; recorded channels */
    int needed[OUTPUTS], needed_count, is_needed[OUTPUTS]; /* those outputs */
    Totals totals;
    Port ports[CORNERS]; /* the last one: its tables are not cleared for each batch */
} March;

static inline real size_of_number(real x)
{
    return either(x < 0.0, -x, x);
}

static inline real larger_of(real a, real b)
{
    return either(b > a, b, a);
}

static inline void shift(Signal *s)
{
    s->past = s->now;
    s->now = s->ahead;
}

static inline void begin_signals(March *m)
{
    for (int c = 0; c < CORNERS; c++) {
        Signal *all[] = {&m->velocity[c], &m->displacement[c], &m->force[c]};
        for (int k = 0; k < 3; k++) {
            all[k]->ahead = all[k]->past = all[k]->older = all[k]->now;
        }
    }
}

/* sums.c: the defects of both terms of every bond and its energies; the time beyond limits; a recorded row; the totals for Python. */
void add_bonds(March *m, const Step *step);
void add_limits(March *m, const Step *step);
void record(March *m, const Sums *sums);
void report(const March *m, const Sums *sums);

#endif
