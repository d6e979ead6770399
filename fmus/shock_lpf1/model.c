/* LPF1: F = F_lag with tau dF_lag/dt = F_s - F_lag (Eq 3.24). */
#include "lag.h"
#include "shock.h"

/* alpha = 1: all of the lagged force is given. */
double law_lag_weight(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 1.0;
}

double law_lag_weight_slope(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 0.0;
}

double law_advance_lag(const Parameters *p, double lagged, double static_start, double static_end, double h)
{
    return advance_lag(lagged, static_start, static_end, p->time_constant, h);
}

const char *law_refuses(const Parameters *p)
{
    (void)p;
    return NULL;
}
