/* A shock at one corner in several setups at once, with the operations of common/shock.c and the curve of its FMU. */
#include "port.h"

#include "elementary_lanes.h"
#include "rest.h"

#include "curve.h"

/* Largest change of damper velocity [m/s] over which F_s is treated as linear, as in common/shock.c. */
static const double STRAIGHT = 0.01;

/* ---- The lag ---------------------------------------------------------------------------------------------------------------- */

/* The factors of a lag over one of `count` pieces of a step of h [s], as in common/lag.h. */
static void find_lag(Port *port, int count, double h)
{
    const double part = count == 1 ? h : h / (double)count;
    for (int i = 0; i < SETUPS; i++) {
        const double ratio = part / port->parameters.time_constant[i];
        const double rise = -exponential_minus_1_of(-ratio);
        port->rise[count][i] = rise;
        port->ramp[count][i] = 1.0 - rise / ratio;
    }
}

static void know_lags(Port *port, int most, double h)
{
    if (port->step != h) {
        port->step = h;
        port->known = 0;
    }
    while (port->known < most) {
        find_lag(port, ++port->known, h);
    }
}

/* ---- The port ----------------------------------------------------------------------------------------------------------------- */

/* alpha = 1 up to lag_full_force, 0 from lag_zero_force, linear between, as in shock_lpnl2/model.c. */
static real lag_weight(const Parameters *p, real f)
{
    const real left = p->lag_zero_force - size_of(f), whole = p->lag_zero_force - p->lag_full_force;
    const truth none = left <= 0.0, all = left >= whole;
    if (in_every(none | all)) {
        return either(none, uniform(0.0), uniform(1.0));
    }
    return either(none, uniform(0.0), either(all, uniform(1.0), left / whole));
}

static real seal_force(const Parameters *p, real v)
{
    const truth is_free = p->seal_friction == 0.0;
    return in_every(is_free) ? uniform(0.0)
                             : either(is_free, uniform(0.0), p->seal_friction * hyperbolic_tangent(v / p->friction_velocity));
}

static real lagged_force(const Port *port, real v, real f)
{
    if (!port->some_hysteresis) {
        return port->lagged;
    }
    const Lagged lagged = {port->lagged, port->travel};
    return either(port->law == HYSTERESIS, hysteresis_force(&port->parameters, lagged, v, f), port->lagged);
}

static void respond(Port *port, real velocity, real displacement, real f)
{
    const Parameters *p = &port->parameters;
    const real v = p->motion_ratio * velocity, lagged = lagged_force(port, v, f), alpha = lag_weight(p, f);
    const real dissipative = alpha * lagged + (1.0 - alpha) * f + seal_force(p, v);
    const real gas = p->gas_preload + p->gas_stiffness * p->motion_ratio * displacement;
    port->now.force = p->motion_ratio * (dissipative + gas);
    port->now.static_force = f;
    port->now.lagged_force = lagged;
    port->now.lag_weight = alpha;
    port->now.dissipated_power = dissipative * v;
    port->now.beyond_fit = either(is_beyond_fit(p, v), uniform(1.0), uniform(0.0));
}

void start_port(Port *port, real velocity, real displacement)
{
    const real v = port->parameters.motion_ratio * velocity, f = valve_force(&port->parameters, v);
    port->some_lag = in_any(port->law == WITH_LAG);
    port->some_hysteresis = in_any(port->law == HYSTERESIS);
    port->lagged = f;
    port->travel = uniform(0.0);
    port->step = 0.0;
    if (port->some_hysteresis) {
        const Lagged lagged = hysteresis_start(&port->parameters, v);
        port->lagged = either(port->law == HYSTERESIS, lagged.velocity, f);
        port->travel = lagged.travel;
    }
    respond(port, velocity, displacement, f);
}

/* The number of linear pieces of F_s while the port velocity goes from start to end. */
static real pieces(const Parameters *p, real from, real to)
{
    const real change = size_of(p->motion_ratio * (to - from)), one = uniform(1.0);
    const truth is_long = change >= STRAIGHT;
    if (!in_any(is_long)) {
        return one;
    }
    const real count = change / STRAIGHT, most = uniform((double)MOST_PIECES);
    const truth is_few = count < most;
    const Short whole = __builtin_convertvector(either(is_few & is_long, count, uniform(0.0)), Short);
    return either(is_long, either(is_few, __builtin_convertvector(whole, real) + 1.0, most), one);
}

/* The smallest and the largest number of pieces of all setups. */
typedef struct {
    int least, most;
} Range;

static Range range_of(real count)
{
    const Short whole = __builtin_convertvector(count, Short);
    Range range = {whole[0], whole[0]};
    for (int i = 1; i < SETUPS; i++) {
        range.least = whole[i] < range.least ? whole[i] : range.least;
        range.most = whole[i] > range.most ? whole[i] : range.most;
    }
    return range;
}

/* The factors of the lag over a piece. */
typedef struct {
    real rise, ramp;
} Lag;

static Lag lag_over_piece(Port *port, real count, Range range, double h)
{
    Lag lag = {uniform(0.0), uniform(0.0)};
    if (port->some_lag) {
        know_lags(port, range.most, h);
        lag.rise = port->rise[range.least];
        lag.ramp = port->ramp[range.least];
        for (int k = range.least + 1; k <= range.most; k++) {
            const truth so_many = count == (double)k;
            lag.rise = either(so_many, port->rise[k], lag.rise);
            lag.ramp = either(so_many, port->ramp[k], lag.ramp);
        }
    }
    return lag;
}

/* Advances the law over a piece, in setups in which it is `needed`. */
static inline void advance_law(Port *port, const Span *piece, const Lag *lag, truth needed)
{
    const real start = piece->static_start, end = piece->static_end;
    real after = end;
    if (port->some_lag) {
        const real lagged = port->lagged + (start - port->lagged) * lag->rise + (end - start) * lag->ramp;
        after = either(port->law == WITH_LAG, lagged, end);
    }
    if (port->some_hysteresis) {
        const truth has_hysteresis = port->law == HYSTERESIS;
        const Lagged found = hysteresis_after(&port->parameters, (Lagged){port->lagged, port->travel}, piece, has_hysteresis & needed);
        after = either(has_hysteresis, found.velocity, after);
        port->travel = found.travel;
    }
    port->lagged = in_every(needed) ? after : either(needed, after, port->lagged);
}

void step_port(Port *port, real from, real to, real displacement, double h, truth active)
{
    const Parameters *p = &port->parameters;
    const real count = pieces(p, from, to);
    const Range range = range_of(count);
    const Lag lag = lag_over_piece(port, count, range, h);
    const real part = port->some_hysteresis ? either(count == 1.0, uniform(h), h / count) : uniform(h);
    real v = p->motion_ratio * from, f = valve_force(p, v);
    for (int k = 1; k <= range.most; k++) {
        const int is_inside = k < range.least; /* in every setup, a piece that is not the last one */
        const truth follows = (double)k <= count;
        real velocity = to;
        if (k < range.most) {
            const real between = from + (to - from) * ((double)k / count);
            velocity = is_inside ? between : either((double)k < count, between, to);
        }
        const real end = p->motion_ratio * velocity;
        const Span piece = {v, f, end, valve_force(p, end), part};
        advance_law(port, &piece, &lag, follows & active);
        f = is_inside ? piece.static_end : either(follows, piece.static_end, f);
        v = end;
    }
    respond(port, to, displacement, f);
}
