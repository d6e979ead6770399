/* Hysteresis: F_v = f0(v) + f1(u) + ks e with a lagged velocity u and a creeping stop e. The same operations in the same order as
 * in eightpost/shock/hysteresis.py. Velocities are those of the damper. */
#include "curve.h"
#include "lag.h"
#include "shock.h"

/* Constants of hysteresis.py: largest number of turns of the stop in a piece; speed at rest; largest relative deviation of a
 * quadratic cell. */
enum { MOST_TURNS = 8, MIDDLE = KNOTS / 2 };
static const double REST = 1e-9;
static const double CELL_ROUNDING = 1e-9;

static inline real signed_like(real size, real sign)
{
    const truth is_zero = sign == 0.0;
    truth is_negative = sign < 0.0;
    if (in_any(is_zero)) {
        is_negative = one_of(is_negative, both_of(is_zero, 1.0 / sign < 0.0));
    }
    return either(is_negative, -size, size);
}

/* ---- The curve of the lagged velocity ------------------------------------------------------------------------------------ */

#ifndef EIGHTPOST_LANES
/* f1 [N]: the integral of the slopes c, which are linear between knots and constant beyond. */
static double lagged_curve(const Parameters *p, double v)
{
    const double *knots = p->curve_knot_velocity, *c = p->curve_lagged_slope;
    const double low = v > knots[0] ? v : knots[0], inside = low < knots[KNOTS - 1] ? low : knots[KNOTS - 1];
    const int k = cell_of(knots, inside), compressed = inside >= 0.0;
    const double bend = (c[k + 1] - c[k]) / (knots[k + 1] - knots[k]);
    double force = 0.0;
    for (int j = MIDDLE; compressed && k > j; j++) {
        force = force + 0.5 * (c[j] + c[j + 1]) * (knots[j + 1] - knots[j]);
    }
    for (int j = MIDDLE - 1; !compressed && k < j; j--) {
        force = force - 0.5 * (c[j] + c[j + 1]) * (knots[j + 1] - knots[j]);
    }
    const double x = inside - knots[compressed ? k : k + 1];
    force += x * (c[compressed ? k : k + 1] + 0.5 * bend * x);
    return force + (v > 0.0 ? c[KNOTS - 1] : c[0]) * (v - inside);
}

#endif

/* ln of the ratio of tau at high speed to that at rest; lanes know it. */
#ifdef EIGHTPOST_LANES
#define GROWTH(p, compressed) either(compressed, (p)->growth[1], (p)->growth[0])
#else
#define GROWTH(p, compressed) logarithm((p)->time_constant[(compressed) ? 2 : 0] / (p)->time_constant[1])
#endif

/* ---- The lag --------------------------------------------------------------------------------------------------------------- */

/* tau at u, and d ln tau / du. */
typedef struct {
    real tau, growth;
} TimeConstant;

static inline TimeConstant time_constant_at(const Parameters *p, real u)
{
    const truth compressed = u >= 0.0;
    const real speed = either(compressed, p->curve_compression_speed, p->curve_rebound_speed);
    const real end = either(compressed, p->time_constant[2], p->time_constant[0]), middle = p->time_constant[1];
    const real share = size_of(u) / (0.5 * speed), within = either(share < 1.0, share, uniform(1.0));
    const truth varies = end != middle;
    TimeConstant found = {middle, uniform(0.0)};
    if (in_any(varies)) {
        const real whole = GROWTH(p, compressed), slope = either(compressed, whole, -whole);
        found.tau = either(varies, middle * exponential(within * whole), middle);
        found.growth = either(both_of(varies, share < 1.0), slope / (0.5 * speed), uniform(0.0));
    }
    return found;
}

static inline real advance_velocity(const Parameters *p, LagFactors *kept, real u, const Piece *piece)
{
    real after = u;
    for (int pass = 0; pass < 2; pass++) {
        const real tau = time_constant_at(p, 0.5 * (u + after)).tau;
        after = advance_lag(kept, u, piece->velocity_start, piece->velocity_end, tau, piece->step);
    }
    return after;
}

/* ---- The stop -------------------------------------------------------------------------------------------------------------- */

static inline real advance_travel(const Parameters *p, LagFactors *kept, real travel, const Piece *piece)
{
    const real limit = p->stop_yield, time = p->stop_time, end = piece->velocity_end;
    real start = piece->velocity_start, step = piece->step;
    truth yields = size_of(travel) > limit, going = step == step;
    for (int turn = 0; turn < MOST_TURNS; turn++) {
        const real before = travel;
        real edge = signed_like(limit, travel), over = before, after = before, ended = before;
        truth ends = going;
        if (in_any(yields)) {
            over = before - edge;
            after = advance_lag(kept, over, start * time, end * time, time, step);
            ends = after * edge >= 0.0;
            ended = edge + after;
        }
        if (!in_every(yields)) {
            const real moved = before + 0.5 * (start + end) * step;
            ends = one_of(both_of(yields, ends), both_of(is_false(yields), size_of(moved) <= limit));
            ended = either(yields, ended, moved);
            edge = either(yields, edge, signed_like(limit, moved));
            after = either(yields, after, moved);
        }
        travel = either(going, either(ends, ended, edge), before);
        going &= is_false(ends);
        if (!in_any(going)) {
            break;
        }
        const real share = either(yields, over / (over - after), (edge - before) / (after - before));
        start += (end - start) * share;
        step *= 1.0 - share;
        yields = is_false(yields);
        going &= is_false(step <= 0.0);
    }
    return travel;
}

/* ---- Functions declared in shock.h ------------------------------------------------------------------------------------------- */

State law_start(const Parameters *p, real velocity, real static_force)
{
    const real reach = p->stop_yield + size_of(velocity) * p->stop_time;
    const State state = {{velocity, either(size_of(velocity) <= uniform(REST), uniform(0.0), signed_like(reach, velocity))}};
    (void)static_force;
    return state;
}

void law_advance(const Parameters *p, LagFactors *kept, State *state, const Piece *piece)
{
    state->at[0] = advance_velocity(p, &kept[0], state->at[0], piece);
    state->at[1] = advance_travel(p, &kept[1], state->at[1], piece);
}

#ifndef EIGHTPOST_LANES

double law_force(const Parameters *p, const State *state, double velocity, double static_force)
{
    const double fixed = static_force - scale(p, velocity) * lagged_curve(p, velocity);
    return fixed + scale(p, state->at[0]) * lagged_curve(p, state->at[0]) + p->stop_stiffness * state->at[1];
}

/* alpha = 1: the lagged force is the whole force of the valves. */
double law_lag_weight(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 1.0;
}

double *law_state(Signals *s, int k)
{
    return k == 0 ? &s->lagged_velocity : &s->stop_travel;
}

/* c [N.s/m]. */
static double lagged_slope(const Parameters *p, double v)
{
    const double *knots = p->curve_knot_velocity, *c = p->curve_lagged_slope;
    if (is_beyond_fit(p, v)) {
        return v > 0.0 ? c[KNOTS - 1] : c[0];
    }
    const int k = cell_of(knots, v);
    return c[k] + (c[k + 1] - c[k]) / (knots[k + 1] - knots[k]) * (v - knots[k]);
}

Slopes law_slopes(const Parameters *p, const State *state, double velocity, double static_force)
{
    const double u = state->at[0], over = size_of(state->at[1]) - p->stop_yield;
    const TimeConstant lag = time_constant_at(p, u);
    const double rate = (velocity - u) / lag.tau;
    const Slopes slopes = {
        .force_by_velocity = valve_slope(p, velocity) - scale(p, velocity) * lagged_slope(p, velocity),
        .force_by_state = {scale(p, u) * lagged_slope(p, u), p->stop_stiffness},
        .rate = {rate, velocity - (over > 0.0 ? signed_like(over, state->at[1]) / p->stop_time : 0.0)},
        .rate_by_velocity = {1.0 / lag.tau, 1.0},
        .rate_by_state = {-1.0 / lag.tau - rate * lag.growth, over > 0.0 ? -1.0 / p->stop_time : 0.0},
    };
    (void)static_force;
    return slopes;
}

static int are_quadratic(const Parameters *p)
{
    const double *knots = p->curve_knot_velocity, *force = p->curve_knot_force, *slope = p->curve_knot_slope;
    double largest = 0.0;
    for (int k = 0; k < KNOTS; k++) {
        largest = size_of(force[k]) > largest ? size_of(force[k]) : largest;
    }
    for (int k = 0; k < KNOTS - 1; k++) {
        const double width = knots[k + 1] - knots[k], rise = force[k + 1] - force[k];
        if (!(size_of(rise - 0.5 * (slope[k] + slope[k + 1]) * width) <= CELL_ROUNDING * largest)) {
            return 0;
        }
    }
    return 1;
}

/* No slope of f0 may be negative: then the law is passive. */
const char *law_refuses(const Parameters *p)
{
    const double *c = p->curve_lagged_slope;
    if (!has_knots(p)) {
        return "a Hysteresis law needs a curve through knots";
    }
    if (!are_quadratic(p)) {
        return "between two knots the force of a Hysteresis law must rise by the mean of the slopes there times the difference of "
               "velocity";
    }
    int fits = c[0] <= p->curve_rebound_slope && c[KNOTS - 1] <= p->curve_compression_slope;
    for (int k = 0; k < KNOTS; k++) {
        fits &= c[k] <= p->curve_knot_slope[k];
    }
    return fits ? NULL : "curve.lagged_slope must not be above curve.knot_slope and the slopes beyond the fitted range";
}

#endif
