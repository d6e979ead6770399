/* Hysteresis, from the file of its FMU, which calls its three time constants by the name of the one of a lag. */
enum { CONTINUOUS_STATES = 2 };
#define SEVERAL_STATES
#define law_lag_weight hysteresis_lag_weight
#define law_start hysteresis_law_start
#define law_state hysteresis_law_state
#define law_advance hysteresis_law_advance
#define law_force hysteresis_law_force
#define law_slopes hysteresis_law_slopes
#define law_refuses hysteresis_refuses
#include "component.h"
#include "lag.h"
#define time_constant time_constants
#include "hysteresis.c.inc"

#include "laws.h"

_Static_assert((int)PARAMETERS == (int)LAW_PARAMETERS, "laws.h has another number of parameters than component.h");

/* Number of piece counts whose factors are kept, as in common/shock.c. */
enum { KEPT = 4 };

static const Parameters *parameters_of(const Law *law)
{
    return (const Parameters *)(const void *)law->parameters;
}

static State state_of(const Law *law)
{
    const State state = {{law->state[0], law->state[1]}};
    return state;
}

static void keep_state(Law *law, const State *state)
{
    law->state[0] = state->at[0];
    law->state[1] = state->at[1];
}

void hysteresis_start(Law *law, double velocity, double static_force)
{
    const State state = law_start(parameters_of(law), velocity, static_force);
    keep_state(law, &state);
}

void hysteresis_advance(Law *law, const Span *s)
{
    const Piece piece = {s->velocity_start, s->static_start, s->velocity_end, s->static_end, s->step};
    LagFactors *kept = (LagFactors *)(void *)law->kept;
    State state = state_of(law);
    law_advance(parameters_of(law), &kept[STATE_COUNT * ((s->count < KEPT ? s->count : KEPT) - 1)], &state, &piece);
    keep_state(law, &state);
}

double hysteresis_force(const Law *law, double velocity, double static_force)
{
    const State state = state_of(law);
    return law_force(parameters_of(law), &state, velocity, static_force);
}
