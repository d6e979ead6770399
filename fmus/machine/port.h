/* A shock at one corner in several setups at once, with the friction of its port: curves, lags and stops are those of the FMUs' files. */
#ifndef EIGHTPOST_PORT_H
#define EIGHTPOST_PORT_H

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
typedef struct {
    real force, static_force, lagged_force, lag_weight, dissipated_power, beyond_fit;
} PortSignals;

/* A cubic of each setup, with the coefficients of cells.h. */
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

/* The cubics of a point: of the damper velocity, and of the lagged velocity of Hysteresis. */
typedef struct {
    Cubic curve, lagged;
} Cubics;

/* Python fills parameters and laws; the rest is derived from them before a run. */
typedef struct {
    Parameters parameters;
    Index law;
    Cells cells[SETUPS];
    Narrow knots[KNOTS]; /* each twice */
    PortFriction friction;
    int some_lag, some_hysteresis, some_knots, some_polynomials, some_seals, has_travel;
    double half; /* half a step [s] */
    real rise, ramp; /* of a lag over half a step */
} Port;

/* ---- The static curve ------------------------------------------------------------------------------------------------------- */

#if defined(__AVX512F__) && EIGHTPOST_SETUPS == 8
/* Gathers a row of eight numbers for each of eight setups: a transposition. */
static inline void gather(const double *const *rows, real *to)
{
    __m512d a[8], b[8];
    for (int k = 0; k < 8; k += 2) {
        const __m512d first = _mm512_loadu_pd(rows[k]), second = _mm512_loadu_pd(rows[k + 1]);
        a[k] = _mm512_unpacklo_pd(first, second);
        a[k + 1] = _mm512_unpackhi_pd(first, second);
    }
    for (int k = 0; k < 2; k++) {
        b[k] = _mm512_shuffle_f64x2(a[k], a[k + 2], 0x88);
        b[k + 2] = _mm512_shuffle_f64x2(a[k], a[k + 2], 0xdd);
        b[k + 4] = _mm512_shuffle_f64x2(a[k + 4], a[k + 6], 0x88);
        b[k + 6] = _mm512_shuffle_f64x2(a[k + 4], a[k + 6], 0xdd);
    }
    for (int k = 0; k < 2; k++) {
        to[k] = (real)_mm512_shuffle_f64x2(b[k], b[k + 4], 0x88);
        to[k + 4] = (real)_mm512_shuffle_f64x2(b[k], b[k + 4], 0xdd);
        to[k + 2] = (real)_mm512_shuffle_f64x2(b[k + 2], b[k + 6], 0x88);
        to[k + 6] = (real)_mm512_shuffle_f64x2(b[k + 2], b[k + 6], 0xdd);
    }
}
#else
static inline void gather(const double *const *rows, real *to)
{
    for (int k = 0; k < SETUPS; k++) {
        for (int c = 0; c < COEFFICIENTS; c++) {
            to[c][k] = rows[k][c];
        }
    }
}
#endif

/* The cubics of two velocities. They are compared with the knots in single precision, both at once: a velocity that is equal to a knot
 * but for that rounding may take the cubic of the neighbouring cell, which has the same value and slope there. */
static inline WITHIN void find_cubics(const Port *port, real v, real w, Cubic *of_v, Cubic *of_w)
{
    const double *rows[2 * SETUPS];
    Narrow both;
    Places cell = {0};
    for (int k = 0; k < SETUPS; k++) {
        both[k] = (float)v[k];
        both[SETUPS + k] = (float)w[k];
    }
    for (int k = 0; k < KNOTS; k++) {
        cell -= both >= port->knots[k]; /* a comparison is -1 where it is true */
    }
    for (int k = 0; k < 2 * SETUPS; k++) {
        rows[k] = port->cells[k % SETUPS][cell[k]];
    }
    gather(rows, of_v->at);
    gather(rows + SETUPS, of_w->at);
}

static inline real force_of(const Cubic *c, real v)
{
    const real x = v - c->at[LEFT];
    return c->at[FORCE] + x * (c->at[SLOPE] + x * (c->at[BEND] + x * c->at[TWIST]));
}

/* f1 of Hysteresis. */
static inline real lagged_part(const Cubic *c, real v)
{
    const real x = v - c->at[LEFT];
    return c->at[LAGGED] + x * (c->at[LAGGED_SLOPE] + x * c->at[LAGGED_BEND]);
}

static inline void find_cubic(const Port *port, real v, Cubic *cubic)
{
    Cubic same;
    find_cubics(port, v, v, cubic, &same);
}

/* F_s [N] at a damper velocity [m/s]; `cubic` is that of about this velocity if there are knots. */
static inline WITHIN real static_force(const Port *port, real v, const Cubic *cubic)
{
    const Parameters *p = &port->parameters;
    if (!port->some_knots) {
        return valve_force(p, v);
    }
    const real force = force_of(cubic, v);
    return port->some_polynomials ? either(has_knots(p), force, valve_force(p, v)) : force;
}

/* ---- The law ------------------------------------------------------------------------------------------------------------------ */

/* alpha = 1 up to lag_full_force, 0 from lag_zero_force, linear between, as in shock_lpnl2/model.c. */
static inline real lag_weight(const Parameters *p, real f)
{
    const real share = (p->lag_zero_force - size_of(f)) * p->per_lag_range;
    return either(share <= 0.0, uniform(0.0), either(share >= 1.0, uniform(1.0), share));
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
        find_cubic(port, to->lagged, cubic);
    }
}

/* The point half a step after `from`, while the velocity changes linearly. `cubics` are those of about its velocities; that of the
 * lagged velocity is found here if it is not `known`. */
static inline WITHIN void follow(const Port *port, const Point *from, real velocity, int known, Cubics *cubics, Point *to)
{
    const Parameters *p = &port->parameters;
    to->velocity = velocity;
    to->static_force = static_force(port, p->motion_ratio * velocity, &cubics->curve);
    to->lagged = to->static_force;
    if (port->some_lag) {
        const real lagged = from->lagged + (from->static_force - from->lagged) * port->rise +
                            (to->static_force - from->static_force) * port->ramp;
        to->lagged = either(port->law == WITH_LAG, lagged, to->lagged);
    }
    if (port->some_hysteresis) {
        follow_hysteresis(port, from, known, &cubics->lagged, to);
    }
    if (port->friction.bristle_force > 0.0) {
        to->bend = bend_after(&port->friction, from->bend, 0.5 * (from->velocity + velocity), uniform(port->half));
    }
}

/* ---- Forces --------------------------------------------------------------------------------------------------------------------- */

/* F_lag of a lag; F_v of Hysteresis, as in shock_hysteresis/model.c. */
static inline WITHIN real lagged_force(const Port *port, const Point *at, const Cubics *cubics)
{
    if (!port->some_hysteresis) {
        return at->lagged;
    }
    const Parameters *p = &port->parameters;
    const real fixed = at->static_force - lagged_part(&cubics->curve, p->motion_ratio * at->velocity);
    const real force = fixed + lagged_part(&cubics->lagged, at->lagged) + p->stop_stiffness * at->travel;
    return either(port->law == HYSTERESIS, force, at->lagged);
}

static inline real seal_force(const Port *port, real v)
{
    const Parameters *p = &port->parameters;
    if (!port->some_seals) {
        return uniform(0.0);
    }
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

static inline real gas_force(const Parameters *p, real displacement)
{
    return p->gas_preload + p->gas_stiffness * p->motion_ratio * displacement;
}

/* The force of shock and friction at a displacement of the port [m]. */
static inline WITHIN real force_at(const Port *port, const Point *at, const Cubics *cubics, real displacement)
{
    const Parameters *p = &port->parameters;
    const real lagged = lagged_force(port, at, cubics), f = at->static_force, alpha = lag_weight(p, f);
    const real dissipative = f + alpha * (lagged - f) + seal_force(port, p->motion_ratio * at->velocity);
    return p->motion_ratio * (dissipative + gas_force(p, displacement)) + friction_force(&port->friction, at, displacement);
}

static PortSignals signals_at(const Port *port, const Point *at, const Cubics *cubics, real displacement)
{
    const Parameters *p = &port->parameters;
    const real f = at->static_force, v = p->motion_ratio * at->velocity;
    PortSignals now = {.static_force = f, .lagged_force = lagged_force(port, at, cubics), .lag_weight = lag_weight(p, f)};
    const real dissipative = f + now.lag_weight * (now.lagged_force - f) + seal_force(port, v);
    now.force = p->motion_ratio * (dissipative + gas_force(p, displacement));
    now.dissipated_power = dissipative * v;
    now.beyond_fit = either(is_beyond_fit(p, v), uniform(1.0), uniform(0.0));
    return now;
}

/* Whether a velocity of the port is beyond the fitted range. */
static inline truth is_beyond(const Port *port, real velocity)
{
    return is_beyond_fit(&port->parameters, port->parameters.motion_ratio * velocity);
}

/* ---- Before a run --------------------------------------------------------------------------------------------------------------- */

static void find_reciprocals(Parameters *p)
{
    p->per_curve_transition_speed = 1.0 / p->curve_transition_speed;
    p->per_curve_transition_width = 1.0 / p->curve_transition_width;
    p->per_lag_range = 1.0 / (p->lag_zero_force - p->lag_full_force);
    for (int side = 0; side < 2; side++) {
        p->growth[side] = logarithm(p->time_constants[2 * side] / p->time_constants[1]);
    }
}

/* Derives what a run needs from the parameters and laws. */
static void prepare_port(Port *port, const PortFriction *friction, double step)
{
    Parameters *p = &port->parameters;
    find_reciprocals(p);
    for (int k = 0; k < SETUPS; k++) {
        double own[PARAMETERS];
        for (int i = 0; i < PARAMETERS; i++) {
            own[i] = ((const real *)p)[i][k];
        }
        find_cells(own, port->law[k] == HYSTERESIS, port->cells[k]);
        for (int i = 0; i < KNOTS; i++) {
            port->knots[i][k] = port->knots[i][SETUPS + k] = (float)p->curve_knot_velocity[i][k];
        }
    }
    port->friction = *friction;
    port->half = 0.5 * step;
    port->some_lag = in_any(port->law == WITH_LAG);
    port->some_hysteresis = in_any(port->law == HYSTERESIS);
    port->some_knots = in_any(has_knots(p));
    port->some_polynomials = !in_every(has_knots(p));
    port->some_seals = !in_every(p->seal_friction == 0.0);
    port->has_travel = !in_every(p->gas_stiffness == 0.0) || friction->port_spring != 0.0;
    const real ratio = port->half / p->time_constant;
    port->rise = -exponential_minus_1(-ratio);
    port->ramp = 1.0 - port->rise / ratio;
}

/* The point of steady motion. */
static void start_point(const Port *port, real velocity, Cubics *cubics, Point *at)
{
    const real v = port->parameters.motion_ratio * velocity;
    memset(at, 0, sizeof *at);
    at->velocity = velocity;
    find_cubic(port, v, &cubics->curve);
    at->static_force = at->lagged = static_force(port, v, &cubics->curve);
    if (port->some_hysteresis) {
        const State state = law_start(&port->parameters, v, at->static_force);
        at->lagged = either(port->law == HYSTERESIS, state.at[0], at->lagged);
        at->travel = state.at[1];
        find_cubic(port, at->lagged, &cubics->lagged);
    }
}

#endif
