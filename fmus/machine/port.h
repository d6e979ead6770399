/* A shock at one corner in several setups at once, with the friction of its port: curves, lags and stops are those of the FMUs' files. */
#ifndef EIGHTPOST_PORT_H
#define EIGHTPOST_PORT_H

#include <math.h>

#include "lanes.h" /* before files that use its names */

#include "car.h"
#include "cells.h"
#include "component.h"
#include "elementary_lanes.h"

#include "curve.h"
#include "friction.h"

enum { CONTINUOUS_STATES = 2 };
#define SEVERAL_STATES
#define time_constant time_constants
#include "hysteresis.c.inc"
#undef time_constant

/* Laws; Polylinear and those with a lag differ only in numbers. */
enum { WITHOUT_LAG = 0, WITH_LAG = 1, HYSTERESIS = 2 };

/* What is recorded of a shock, in the order of eightpost/machine/run.py. */
enum { FORCE, STATIC_FORCE, LAGGED_FORCE, LAG_WEIGHT, DISSIPATED_POWER, BEYOND_FIT, VELOCITY };

/* Places of knots in a search by halves; velocities are usually between half of them, the first of which is USUAL. */
enum { SLOTS = 31, USUAL = 5 };

/* A cubic of each setup in v. */
typedef struct {
    real at[COEFFICIENTS];
} Cubic;

/* A shock and its port at one time. */
typedef struct {
    real velocity; /* of the port [m/s] */
    real static_force; /* F_s [N] */
    real lagged, travel; /* F_lag, or the lagged velocity of Hysteresis [m/s]; the travel of its stop [m] */
    real bend; /* of the friction's bristle [m] */
} Point;

/* The cubics of a point: F_s and f1 of Hysteresis at the damper velocity, and f1 at the lagged velocity. */
typedef struct {
    Cubic curve, fixed, lagged;
} Cubics;

/* What occurs in any port of a run. */
typedef struct {
    int hysteresis, knots, polynomials, seals, friction, travel, ratios;
} Kinds;

/* Python fills parameters and laws; the rest is derived from them before a run. */
typedef struct {
    Parameters parameters;
    Index law;
    Narrow knots[SLOTS]; /* each twice; after the last one infinity */
    Cells curve[SETUPS], lagged[SETUPS];
    PortFriction friction;
    number half; /* half a step [s] */
    real left, faded, ramp; /* F_lag after half a step by F_lag and F_s before and F_s after it */
    real preload; /* of the gas at the port [N] */
} Port;

/* ---- The static curve ------------------------------------------------------------------------------------------------------- */

static inline WITHIN Narrow chosen_of(Places condition, Narrow a, Narrow b)
{
    return (Narrow)(((Places)a & condition) | ((Places)b & ~condition));
}

/* Halves the knots in question, of which there are 2 half + 1. */
static inline WITHIN void halve(const Narrow *from, int half, Narrow both, Places *first, Narrow *to)
{
    const Places above = both >= from[half];
    *first += above & (COEFFICIENTS * (half + 1));
    UNROLLED
    for (int k = 0; k < half; k++) {
        to[k] = chosen_of(above, from[half + 1 + k], from[k]);
    }
}

/* The first coefficients of the cells of two velocities of each setup.
 * Velocities and knots are compared in single precision: a velocity that is equal to a knot but for that rounding may take the cubic
 * of the neighbouring cell, which has the same value and slope there. */
static inline WITHIN void find_both(const Port *port, real v, real w, Places *first)
{
    Narrow both, left[SLOTS / 2];
    UNROLLED
    for (int k = 0; k < SETUPS; k++) {
        both[k] = (float)v[k];
        both[SETUPS + k] = (float)w[k];
    }
    const Narrow *knots = port->knots;
    if (are_all((both >= knots[USUAL - 1]) & (both < knots[USUAL + SLOTS / 2]))) {
        *first = (Places){0} + COEFFICIENTS * USUAL;
        halve(knots + USUAL, 7, both, first, left);
    } else {
        *first = (Places){0};
        halve(knots, 15, both, first, left);
        halve(left, 7, both, first, left);
    }
    halve(left, 3, both, first, left);
    halve(left, 1, both, first, left);
    halve(left, 0, both, first, left);
    IN_MEMORY(*first); /* from where numbers are faster taken */
}

/* The cubics of the first or the second velocity. */
static inline WITHIN void gather(const Cells *cells, const Places *found, int which, Cubic *cubic)
{
    const number *rows[SETUPS];
    for (int k = 0; k < SETUPS; k++) {
        rows[k] = &cells[k][0][0] + (unsigned)(*found)[which * SETUPS + k];
    }
    transpose(rows, cubic->at);
}

static inline real value_at(const Cubic *c, real v)
{
    return c->at[0] + v * (c->at[1] + v * (c->at[2] + v * c->at[3]));
}

/* The cubics of two points of a port but those of the lagged velocity. */
static inline WITHIN void gather_cubics(const Port *port, Kinds kinds, const Places *found, Cubics *cubics)
{
    UNROLLED
    for (int which = 0; which < 2; which++) {
        gather(port->curve, found, which, &cubics[which].curve);
        if (kinds.hysteresis) {
            gather(port->lagged, found, which, &cubics[which].fixed);
        }
    }
}

static APART void find_lagged(const Port *port, real velocity, Cubic *cubic)
{
    Places found;
    find_both(port, velocity, velocity, &found);
    gather(port->lagged, &found, 0, cubic);
}

/* A velocity of the port at the damper, or a force of the damper at the port. */
static inline WITHIN real by_ratio(const Port *port, Kinds kinds, real value)
{
    return kinds.ratios ? port->parameters.motion_ratio * value : value;
}

/* F_s [N] at a damper velocity [m/s]; `cubic` is that of about this velocity if there are knots. */
static inline WITHIN real static_force(const Port *port, Kinds kinds, real v, const Cubic *cubic)
{
    const Parameters *p = &port->parameters;
    if (!kinds.knots) {
        return valve_force(p, v);
    }
    const real force = value_at(cubic, v);
    return kinds.polynomials ? either(has_knots(p), force, valve_force(p, v)) : force;
}

/* ---- The law ------------------------------------------------------------------------------------------------------------------ */

/* alpha = 1 up to lag_full_force, 0 from lag_zero_force, linear between, as in shock_lpnl2/model.c. */
static inline real lag_weight(const Parameters *p, real f)
{
    const real share = p->lag_share - size_of(f) * p->per_lag_range, some = either(share < 0.0, uniform(0.0), share);
    return either(some > 1.0, uniform(1.0), some);
}

static inline real bend_after(const PortFriction *f, real bend, real v, real h)
{
    const real limit = f->bristle_reach * (1.0 + static_excess(f->bristle_static_ratio, f->bristle_stribeck_velocity, v));
    return bent_bristle(bend, v, limit, h);
}

/* The states of Hysteresis half a step after `from`. */
static APART void follow_hysteresis(const Port *port, const Point *from, int known, Cubic *cubic, Point *to)
{
    const Parameters *p = &port->parameters;
    LagFactors none[2];
    State state = {{from->lagged, from->travel}};
    const Piece piece = {
        p->motion_ratio * from->velocity, from->static_force, p->motion_ratio * to->velocity, to->static_force, uniform(port->half),
    };
    law_advance(p, none, &state, &piece);
    const truth is_hysteresis = port->law == HYSTERESIS;
    to->lagged = either(is_hysteresis, state.at[0], to->lagged);
    to->travel = state.at[1];
    if (!known) {
        find_lagged(port, to->lagged, cubic);
    }
}

/* The point half a step after `from`, while the velocity changes linearly. `cubics` are those of about its velocities; that of the
 * lagged velocity is found here if it is not `known`. */
static inline WITHIN void follow(const Port *port, Kinds kinds, const Point *from, real velocity, int known, Cubics *cubics, Point *to)
{
    to->velocity = velocity;
    to->static_force = static_force(port, kinds, by_ratio(port, kinds, velocity), &cubics->curve);
    to->lagged = (port->left * from->lagged + port->faded * from->static_force) + port->ramp * to->static_force;
    if (kinds.hysteresis) {
        follow_hysteresis(port, from, known, &cubics->lagged, to);
    }
    if (kinds.friction && port->friction.bristle_force > 0.0) {
        to->bend = bend_after(&port->friction, from->bend, 0.5 * (from->velocity + velocity), uniform(port->half));
    }
}

/* ---- Forces --------------------------------------------------------------------------------------------------------------------- */

/* F_lag of a lag; F_v of Hysteresis, as in shock_hysteresis/model.c. */
static inline WITHIN real lagged_force(const Port *port, Kinds kinds, const Point *at, const Cubics *cubics)
{
    if (!kinds.hysteresis) {
        return at->lagged;
    }
    const Parameters *p = &port->parameters;
    const real fixed = at->static_force - value_at(&cubics->fixed, p->motion_ratio * at->velocity);
    const real force = fixed + value_at(&cubics->lagged, at->lagged) + p->stop_stiffness * at->travel;
    return either(port->law == HYSTERESIS, force, at->lagged);
}

static inline real seal_force(const Parameters *p, real v)
{
    return either(p->seal_friction == 0.0, uniform(0.0), p->seal_friction * hyperbolic_tangent(v / p->friction_velocity));
}

static inline WITHIN real friction_force(const PortFriction *f, const Point *at, real displacement)
{
    real force = f->port_spring * (displacement * displacement);
    if (f->friction_force > 0.0) {
        force += f->friction_force * hyperbolic_tangent(at->velocity / f->friction_velocity);
    }
    return f->bristle_force > 0.0 ? force + f->bristle_force / f->bristle_reach * at->bend : force;
}

/* The force of the valves and the seals [N]. */
static inline WITHIN real dissipative_force(const Port *port, Kinds kinds, const Point *at, const Cubics *cubics)
{
    const Parameters *p = &port->parameters;
    const real f = at->static_force, dissipative = f + lag_weight(p, f) * (lagged_force(port, kinds, at, cubics) - f);
    return kinds.seals ? dissipative + seal_force(p, p->motion_ratio * at->velocity) : dissipative;
}

/* The force of the shock at a displacement of the port [m]. */
static inline WITHIN real shock_force(const Port *port, Kinds kinds, const Point *at, const Cubics *cubics, real displacement)
{
    const Parameters *p = &port->parameters;
    const real force = dissipative_force(port, kinds, at, cubics);
    const real whole = kinds.travel ? force + p->gas_stiffness * p->motion_ratio * displacement : force;
    return by_ratio(port, kinds, whole) + port->preload;
}

/* That of shock and friction. */
static inline WITHIN real force_at(const Port *port, Kinds kinds, const Point *at, const Cubics *cubics, real displacement)
{
    const real force = shock_force(port, kinds, at, cubics, displacement);
    return kinds.friction ? force + friction_force(&port->friction, at, displacement) : force;
}

static real signal_at(const Port *port, Kinds kinds, const Point *at, const Cubics *cubics, real displacement, int number)
{
    const Parameters *p = &port->parameters;
    const real v = p->motion_ratio * at->velocity;
    switch (number) {
    case STATIC_FORCE:
        return at->static_force;
    case LAGGED_FORCE:
        return lagged_force(port, kinds, at, cubics);
    case LAG_WEIGHT:
        return lag_weight(p, at->static_force);
    case DISSIPATED_POWER:
        return dissipative_force(port, kinds, at, cubics) * v;
    case BEYOND_FIT:
        return either(is_beyond_fit(p, v), uniform(1.0), uniform(0.0));
    case VELOCITY:
        return at->velocity;
    default:
        return shock_force(port, kinds, at, cubics, displacement);
    }
}

/* ---- Before a run --------------------------------------------------------------------------------------------------------------- */

static void find_reciprocals(Parameters *p)
{
    p->per_curve_transition_speed = 1.0 / p->curve_transition_speed;
    p->per_curve_transition_width = 1.0 / p->curve_transition_width;
    p->per_lag_range = 1.0 / (p->lag_zero_force - p->lag_full_force);
    p->lag_share = p->lag_zero_force * p->per_lag_range;
    for (int side = 0; side < 2; side++) {
        p->growth[side] = logarithm(p->time_constants[2 * side] / p->time_constants[1]);
    }
}

/* Derives what a run needs from the parameters and laws. */
static void prepare_port(Port *port, const PortFriction *friction, double step, Kinds *kinds)
{
    Parameters *p = &port->parameters;
    find_reciprocals(p);
    for (int k = 0; k < SETUPS; k++) {
        double own[PARAMETERS];
        for (int i = 0; i < PARAMETERS; i++) {
            own[i] = ((const real *)p)[i][k];
        }
        find_cells(own, port->law[k] == HYSTERESIS, port->curve[k], port->lagged[k]);
        for (int i = 0; i < SLOTS; i++) {
            port->knots[i][k] = port->knots[i][SETUPS + k] = i < KNOTS ? (float)p->curve_knot_velocity[i][k] : (float)INFINITY;
        }
    }
    port->friction = *friction;
    port->half = (number)(0.5 * step);
    kinds->hysteresis |= in_any(port->law == HYSTERESIS);
    kinds->knots |= in_any(has_knots(p));
    kinds->polynomials |= !in_every(has_knots(p));
    kinds->seals |= !in_every(p->seal_friction == 0.0);
    kinds->friction |= friction->friction_force > 0.0 || friction->bristle_force > 0.0 || friction->port_spring != 0.0;
    kinds->ratios |= !in_every(p->motion_ratio == 1.0);
    kinds->travel |= !in_every(p->gas_stiffness == 0.0) || friction->port_spring != 0.0;
    const real ratio = port->half / p->time_constant, rise = -exponential_minus_1(-ratio);
    const real none = uniform(0.0), one = uniform(1.0);
    port->left = either(port->law == WITHOUT_LAG, none, 1.0 - rise);
    port->ramp = either(port->law == WITHOUT_LAG, one, 1.0 - rise / ratio);
    port->faded = 1.0 - port->left - port->ramp;
    port->preload = p->motion_ratio * p->gas_preload;
}

/* The point of steady motion. */
static void start_point(const Port *port, Kinds kinds, real velocity, Cubics *cubics, Point *at)
{
    const real v = port->parameters.motion_ratio * velocity;
    Cubics both[2];
    Places found;
    memset(at, 0, sizeof *at);
    at->velocity = velocity;
    find_both(port, v, v, &found);
    gather_cubics(port, kinds, &found, both);
    *cubics = both[0];
    at->static_force = at->lagged = static_force(port, kinds, v, &cubics->curve);
    if (kinds.hysteresis) {
        const State state = law_start(&port->parameters, v, at->static_force);
        at->lagged = either(port->law == HYSTERESIS, state.at[0], at->lagged);
        at->travel = state.at[1];
        find_lagged(port, at->lagged, &cubics->lagged);
    }
}

#endif
