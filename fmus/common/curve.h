/* The static curve F_s = f(v) (Eq 3.23), v the damper velocity, bit for bit as in eightpost/shock/curve.py: a spline through knots,
 * or polynomials if there are no knots. A polynomial with weight 0 is not computed. */
#ifndef EIGHTPOST_CURVE_H
#define EIGHTPOST_CURVE_H

#include "component.h"
#include "real.h"

/* Number of coefficients of the polynomials, and number of knots. */
enum {
    INNER = sizeof ((Parameters *)NULL)->curve_inner / sizeof(real),
    OUTER = sizeof ((Parameters *)NULL)->curve_compression / sizeof(real),
    KNOTS = sizeof ((Parameters *)NULL)->curve_knot_velocity / sizeof(real)
};

/* c_0 + c_1 s + c_2 s^2 + ... as four independent sums in powers of s^4. */
static inline real polynomial(const real *coefficients, int count, real s)
{
    const real square = s * s, fourth = square * square;
    real sum[4] = {ZERO};
    for (int k = count - 1; k >= 0; k--) {
        sum[k % 4] = k + 4 < count ? sum[k % 4] * fourth + coefficients[k] : coefficients[k];
    }
    return (sum[0] + s * sum[1]) + square * (sum[2] + s * sum[3]);
}

/* A value over a parameter; in lanes times its reciprocal, which is known. */
#ifdef EIGHTPOST_LANES
#define RATIO(value, p, name) ((value) * (p)->per_##name)
#else
#define RATIO(value, p, name) ((value) / (p)->name)
#endif

/* The share of the outer polynomial at a distance of the speed from the transition's middle. */
static inline real outer_share(const Parameters *p, real apart)
{
    const real half = 0.5 * p->curve_transition_width;
    const truth is_outer = apart >= half, is_inner = apart <= -half;
    if (in_every(one_of(is_outer, is_inner))) {
        return either(is_outer, uniform(1.0), uniform(0.0));
    }
    return either(is_outer, uniform(1.0), either(is_inner, uniform(0.0), RATIO(apart, p, curve_transition_width) + 0.5));
}

static inline real inner_force(const Parameters *p, real v)
{
    const real s = RATIO(v, p, curve_transition_speed);
    return s * polynomial(p->curve_inner, INNER, s);
}

static inline real outer_force(const Parameters *p, real v)
{
    const real s = RATIO(size_of(v) - p->curve_transition_speed, p, curve_transition_speed);
    const truth compressed = v > 0.0;
    real force = uniform(0.0);
    if (in_any(compressed)) {
        force = polynomial(p->curve_compression, OUTER, s);
    }
    return in_every(compressed) ? force : either(compressed, force, polynomial(p->curve_rebound, OUTER, s));
}

static inline truth has_knots(const Parameters *p)
{
    return p->curve_knot_velocity[KNOTS - 1] > 0.0;
}

#ifndef EIGHTPOST_LANES
/* The index of the last knot that is not above a velocity, from 0 to KNOTS - 2, by bisection. */
static inline int cell_of(const double *knots, double v)
{
    int low = 0, high = KNOTS - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (v < knots[middle]) {
            high = middle;
        } else {
            low = middle;
        }
    }
    return low;
}

/* A cell between two knots: its width, the rise of the force, and width times slope at both ends. */
typedef struct {
    double width, rise, start, end;
    double x; /* place of a velocity in the cell, from 0 to 1 */
    double force; /* at the start */
} Cell;

static inline Cell cell_at(const Parameters *p, double v)
{
    const double *knots = p->curve_knot_velocity, *forces = p->curve_knot_force, *slopes = p->curve_knot_slope;
    const int k = cell_of(knots, v);
    const double left = knots[k], force = forces[k], width = knots[k + 1] - left;
    const Cell cell = {width, forces[k + 1] - force, width * slopes[k], width * slopes[k + 1], (v - left) / width, force};
    return cell;
}

/* The coefficients of the force in the square and the cube of x. */
static inline double bend_of(const Cell *c)
{
    return 3.0 * c->rise - 2.0 * c->start - c->end;
}

static inline double twist_of(const Cell *c)
{
    return c->start + c->end - 2.0 * c->rise;
}

static inline double force_through_knots(const Parameters *p, double v)
{
    const Cell c = cell_at(p, v);
    return c.force + c.x * (c.start + c.x * (bend_of(&c) + c.x * twist_of(&c)));
}
#endif

static inline real force_of_polynomials(const Parameters *p, real v)
{
    const real apart = size_of(v) - p->curve_transition_speed;
    real inner = uniform(0.0);
    if (in_any(apart < 0.5 * p->curve_transition_width)) {
        inner = inner_force(p, v);
    }
    if (in_every(apart <= -(0.5 * p->curve_transition_width))) {
        return inner;
    }
    const real share = outer_share(p, apart), outer = outer_force(p, v);
    const truth is_inner = share == 0.0, is_outer = share == 1.0;
    return in_every(is_outer) ? outer : either(is_inner, inner, either(is_outer, outer, (1.0 - share) * inner + share * outer));
}

/* Lanes know the cubics between knots (machine/cells.c). */
static inline real fitted_force(const Parameters *p, real v)
{
#ifndef EIGHTPOST_LANES
    if (has_knots(p)) {
        return force_through_knots(p, v);
    }
#endif
    return force_of_polynomials(p, v);
}

static inline truth is_beyond_fit(const Parameters *p, real v)
{
    return one_of(v > p->curve_compression_speed, v < -p->curve_rebound_speed);
}

/* Beyond the fitted range the curve goes on as a straight line. */
static APART real force_beyond_fit(const Parameters *p, real v, truth above, truth below)
{
    const real high = p->curve_compression_speed, low = -p->curve_rebound_speed;
    const real force = fitted_force(p, either(above, high, either(below, low, v)));
    return either(above, force + p->curve_compression_slope * (v - high),
                  either(below, force + p->curve_rebound_slope * (v - low), force));
}

static inline real curve_force(const Parameters *p, real v)
{
    const truth above = v > p->curve_compression_speed, below = v < -p->curve_rebound_speed;
    return in_any(one_of(above, below)) ? force_beyond_fit(p, v, above, below) : fitted_force(p, v);
}

static inline real scale(const Parameters *p, real v)
{
    return either(v > 0.0, p->compression_scale, p->rebound_scale);
}

/* F_s [N] with the port's scales. */
static inline real valve_force(const Parameters *p, real v)
{
    return scale(p, v) * curve_force(p, v);
}

#ifndef EIGHTPOST_LANES

/* ---- Slopes, for model exchange ---------------------------------------------------------------------------------------------- */

/* c_1 + 2 c_2 s + 3 c_3 s^2 + ... */
static inline double polynomial_slope(const double *coefficients, int count, double s)
{
    double value = 0.0;
    for (int k = count - 1; k >= 1; k--) {
        value = value * s + (double)k * coefficients[k];
    }
    return value;
}

static inline double slope_through_knots(const Parameters *p, double v)
{
    const Cell c = cell_at(p, v);
    const double bend = 2.0 * bend_of(&c), twist = 3.0 * twist_of(&c);
    return (c.start + c.x * (bend + c.x * twist)) / c.width;
}

static inline double fitted_slope(const Parameters *p, double v)
{
    if (has_knots(p)) {
        return slope_through_knots(p, v);
    }
    const double side = v > 0.0 ? 1.0 : -1.0, v_t = p->curve_transition_speed;
    const double *coefficients = v > 0.0 ? p->curve_compression : p->curve_rebound;
    const double share = outer_share(p, size_of(v) - v_t), s = v / v_t;
    const double inner = polynomial(p->curve_inner, INNER, s) + s * polynomial_slope(p->curve_inner, INNER, s);
    const double outer = side * polynomial_slope(coefficients, OUTER, (size_of(v) - v_t) / v_t);
    const double slope = ((1.0 - share) * inner + share * outer) / v_t;
    return share > 0.0 && share < 1.0
               ? slope + side * (outer_force(p, v) - inner_force(p, v)) / p->curve_transition_width
               : slope;
}

static inline double curve_slope(const Parameters *p, double v)
{
    if (is_beyond_fit(p, v)) {
        return v > 0.0 ? p->curve_compression_slope : p->curve_rebound_slope;
    }
    return fitted_slope(p, v);
}

static inline double valve_slope(const Parameters *p, double v)
{
    return scale(p, v) * curve_slope(p, v);
}

#endif
#endif
