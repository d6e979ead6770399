/* Maxwell, from the file of its FMU. */
enum { CONTINUOUS_STATES = 1 };
#define law_lag_weight maxwell_lag_weight
#define law_lag_weight_slope maxwell_lag_weight_slope
#define law_advance_lag maxwell_advance_lag
#define law_rate maxwell_rate
#define law_refuses maxwell_refuses
#include "maxwell.c.inc"

#include "laws.h"

_Static_assert((int)PARAMETERS == (int)LAW_PARAMETERS, "laws.h has another number of parameters than component.h");

void maxwell_start(Law *law, double velocity, double static_force)
{
    (void)velocity;
    law->state[0] = static_force;
}

void maxwell_advance(Law *law, const Span *s)
{
    const Piece piece = {s->velocity_start, s->static_start, s->velocity_end, s->static_end, s->step};
    law->state[0] = law_advance_lag((const Parameters *)(const void *)law->parameters, NULL, law->state[0], &piece);
}

double maxwell_force(const Law *law, double velocity, double static_force)
{
    (void)velocity;
    (void)static_force;
    return law->state[0];
}
