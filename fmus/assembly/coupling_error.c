/* How far the forces are off that the vehicle was given: meters that run with the micro steps, and what they tell. */
#include <float.h>
#include <string.h>

#include "elementary.h"
#include "machine.h"

/* An extrapolated value that goes linearly to the end of a step misses this share of its defect there, in the mean over the
 * step: a parabola through both ends of the last step and the end of this one (docs/coupling.md). */
static const double MEAN_DEFECT = 5.0 / 12.0;

/* Of a force that has moved by less than this, of its mean and of 1 N, no share is told: it would be one of roundings. */
static const double LEAST_SPREAD = 1e-4;

/* Adds the squares of what each force was taken for at the end of the micro step less what came; and its mean, and its
 * squares about that, with no difference of large numbers (West, Comm. ACM 22 (1979) 532-535). */
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

/* Bit by bit the same on every platform, without the C library: Newton's iteration from half the exponent. */
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

/* N, standard deviation since the start. */
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
