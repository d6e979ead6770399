/* Maxwell in several setups at once, from the file of its FMU. */
#include "laws.h"

enum { CONTINUOUS_STATES = 1 };
#include "elementary_lanes.h"
#include "maxwell.c.inc"

real maxwell_after(const Parameters *p, real force, const Span *s, truth needed)
{
    const Piece piece = {s->velocity_start, s->static_start, s->velocity_end, s->static_end, s->step};
    return advance_force(p, force, &piece, needed);
}
