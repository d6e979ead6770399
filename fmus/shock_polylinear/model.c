/* Polylinear: F = F_s = f(v) (Eq 3.23). */
#include "shock.h"

/* alpha = 0: the force has no lagged part. */
double law_lag_weight(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 0.0;
}

double law_lag_weight_slope(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 0.0;
}

/* F_lag = F_s: there is no lag. */
double law_advance_lag(const Parameters *p, LagFactors *kept, double lagged, const Piece *piece)
{
    (void)p;
    (void)kept;
    (void)lagged;
    return piece->static_end;
}

/* There is no lag, and so no continuous state. */
Rate law_rate(const Parameters *p, double lagged, double static_force)
{
    const Rate none = {0.0, 0.0, 0.0};
    (void)p;
    (void)lagged;
    (void)static_force;
    return none;
}

const char *law_refuses(const Parameters *p)
{
    (void)p;
    return NULL;
}
