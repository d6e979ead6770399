/* The first-order lag tau dF_lag/dt = F_s - F_lag (Eq 3.24), exact over any step: eightpost/shock/law.py. */
#ifndef EIGHTPOST_LAG_H
#define EIGHTPOST_LAG_H

#include "elementary.h"
#include "shock.h"

#ifdef EIGHTPOST_LANES

/* F_lag [N] after h [s] in which F_s changes linearly from start to end [N]. */
static inline real advance_lag(LagFactors *none, real lagged, real static_start, real static_end, real time_constant, real h)
{
    (void)none;
    const real ratio = h / time_constant, rise = -exponential_minus_1(-ratio), ramp = 1.0 - rise / ratio;
    return lagged + (static_start - lagged) * rise + (static_end - static_start) * ramp;
}

#else

/* The same after h [s]; the factors are kept. */
static inline double advance_lag(LagFactors *f, double lagged, double static_start, double static_end, double time_constant,
                                 double h)
{
    if (h != f->step || time_constant != f->time_constant) {
        const double ratio = h / time_constant;
        f->step = h;
        f->time_constant = time_constant;
        f->rise = -exponential_minus_1(-ratio);
        f->ramp = 1.0 - f->rise / ratio;
    }
    return lagged + (static_start - lagged) * f->rise + (static_end - static_start) * f->ramp;
}

/* dF_lag/dt. */
static inline Rate lag_rate(double lagged, double static_force, double time_constant)
{
    const Rate rate = {(static_force - lagged) / time_constant, -1.0 / time_constant, 1.0 / time_constant};
    return rate;
}

#endif
#endif
