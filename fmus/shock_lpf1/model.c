/* LPF1: F = F_lag with tau dF_lag/dt = F_s - F_lag (Eq 3.24). */
#include "lag.h"
#include "shock.h"

/* alpha = 1: the force is the lagged force. */
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

double law_advance_lag(const Parameters *p, LagFactors *kept, double lagged, const Piece *piece)
{
    return advance_lag(kept, lagged, piece->static_start, piece->static_end, p->time_constant, piece->step);
}

Rate law_rate(const Parameters *p, double lagged, double static_force)
{
    return lag_rate(lagged, static_force, p->time_constant);
}

const char *law_refuses(const Parameters *p)
{
    (void)p;
    return NULL;
}
