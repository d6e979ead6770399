/* LPNL2: F = alpha F_lag + (1 - alpha) F_s with tau dF_lag/dt = F_s - F_lag (Eq 3.25). */
#include "lag.h"
#include "shock.h"

/* alpha = 1 up to lag_full_force, 0 from lag_zero_force, linear between (Fig 3.8). */
double law_lag_weight(const Parameters *p, double static_force)
{
    const double size = static_force < 0.0 ? -static_force : static_force;
    const double left = p->lag_zero_force - size, whole = p->lag_zero_force - p->lag_full_force;
    return left <= 0.0 ? 0.0 : left >= whole ? 1.0 : left / whole;
}

double law_lag_weight_slope(const Parameters *p, double static_force)
{
    const double weight = law_lag_weight(p, static_force), side = static_force < 0.0 ? 1.0 : -1.0;
    return weight > 0.0 && weight < 1.0 ? side / (p->lag_zero_force - p->lag_full_force) : 0.0;
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
    return p->lag_full_force < p->lag_zero_force ? NULL : "lag_zero_force must be greater than lag_full_force";
}
