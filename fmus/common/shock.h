/* What a shock law gives to the port of docs/ports.md (common/shock.c), like ShockLaw in eightpost/shock/law.py. */
#ifndef EIGHTPOST_SHOCK_H
#define EIGHTPOST_SHOCK_H

#include "component.h"

/* alpha [1], the share of the lagged force, at a static force [N]. */
double law_lag_weight(const Parameters *p, double static_force);
/* d alpha / d F_s [1/N]. */
double law_lag_weight_slope(const Parameters *p, double static_force);
/* F_lag [N] after h [s] in which F_s goes linearly from start to end [N]. */
double law_advance_lag(const Parameters *p, double lagged, double static_start, double static_end, double h);
/* The reason why the law's own parameters do not fit each other, or NULL. */
const char *law_refuses(const Parameters *p);

#endif
