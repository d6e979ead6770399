/* The error of the forces applied to the vehicle: estimators that are updated in every micro step, and their results. */
#include <float.h>
#include <string.h>

#include "elementary.h"
#include "machine.h"

/* The error of a linearly extrapolated value, averaged over a step, is this share of its defect at the end, for a parabola through
 * both ends of the last step and the end of this one (docs/explanation/coupling.md). */
static const double MEAN_DEFECT = 5.0 / 12.0;

/* If a force has changed by less than this share of its mean and of 1 N, its error is reported as 0: it would be mostly rounding. */
static const double LEAST_SPREAD = 1e-4;

/* Adds the squares of the defects (extrapolated force at the end of the micro step minus the computed one), and updates the mean of
 * each force and the squares about it, without differences of large numbers (West, Comm. ACM 22 (1979) 532-535). */
void add_defects(const Machine *m, double *state, double h)
{
    state[DURATION] += h;
    for (int s = 0; s < FORCES; s++) {
        const double missed = m->now[s] + m->slope[s] * h - m->ahead[s], apart = m->ahead[s] - state[MEAN + s];
        state[DEFECT + s] += missed * missed * h;
        state[MEAN + s] += apart * (h / state[DURATION]);
        state[SPREAD + s] += h * apart * (m->ahead[s] - state[MEAN + s]);
    }
}

int are_sound(const Machine *m, const double *state)
{
    int sound = 1;
    for (int s = 0; s < COUPLED; s++) {
        sound &= is_finite(m->now[s]) && is_finite(m->slope[s]);
    }
    for (int k = DEFECT; k <= DURATION; k++) {
        sound &= is_finite(state[k]);
    }
    return sound;
}

/* Square root with the same bits on every platform, without the C library: Newton's iteration from half the exponent. */
static double square_root(double x)
{
    uint64_t bits;
    double root;
    if (!(x > DBL_MIN)) {
        return 0.0;
    }
    memcpy(&bits, &x, sizeof bits);
    bits = (bits >> 1) + (UINT64_C(1023) << 51);
    memcpy(&root, &bits, sizeof root);
    for (int k = 0; k < 5; k++) {
        root = 0.5 * (root + x / root);
    }
    return root;
}

double local_error(const double *state, int s)
{
    return state[DURATION] > 0.0 ? MEAN_DEFECT * square_root(state[DEFECT + s] / state[DURATION]) : 0.0;
}

/* Standard deviation since the start [N]. */
static double spread(const double *state, int s)
{
    return state[DURATION] > 0.0 ? square_root(state[SPREAD + s] / state[DURATION]) : 0.0;
}

double worst_error(const double *state)
{
    double worst = 0.0;
    for (int s = 0; s < FORCES; s++) {
        const double size = spread(state, s), least = LEAST_SPREAD * (size_of(state[MEAN + s]) + 1.0);
        const double percent = size > least ? 100.0 * local_error(state, s) / size : 0.0;
        worst = percent > worst ? percent : worst;
    }
    return worst;
}
