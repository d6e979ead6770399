/* Hysteresis in several setups at once, from the file of its FMU, which calls its three time constants by the name of the one of a
 * lag. */
#include "laws.h"

enum { CONTINUOUS_STATES = 2 };
#define SEVERAL_STATES
#define time_constant time_constants
#include "elementary_lanes.h"
#include "lag.h"
#include "hysteresis.c.inc"

static State state_of(Lagged lagged)
{
    const State state = {{lagged.velocity, lagged.travel}};
    return state;
}

Lagged hysteresis_start(const Parameters *p, real velocity)
{
    const State state = law_start(p, velocity, uniform(0.0));
    return (Lagged){state.at[0], state.at[1]};
}

Lagged hysteresis_after(const Parameters *p, Lagged before, const Span *s, truth needed)
{
    const Piece piece = {s->velocity_start, s->static_start, s->velocity_end, s->static_end, s->step};
    LagFactors none[2];
    State state = state_of(before);
    law_advance(p, none, &state, &piece);
    return (Lagged){either(needed, state.at[0], before.velocity), either(needed, state.at[1], before.travel)};
}

real hysteresis_force(const Parameters *p, Lagged lagged, real velocity, real static_force)
{
    const State state = state_of(lagged);
    return law_force(p, &state, velocity, static_force);
}
