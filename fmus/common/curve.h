/* The static curve F_s = f(v) (Eq 3.23), v the damper velocity, bit for bit as in eightpost/shock/curve.py: a spline through knots,
 * or polynomials if there are no knots. A polynomial with weight 0 is not computed. */
#ifndef EIGHTPOST_CURVE_H
#define EIGHTPOST_CURVE_H

#include "component.h"

/* Number of coefficients of the polynomials, and number of knots. */
enum {
    INNER = sizeof ((Parameters *)NULL)->curve_inner / sizeof(double),
    OUTER = sizeof ((Parameters *)NULL)->curve_compression / sizeof(double),
    KNOTS = sizeof ((Parameters *)NULL)->curve_knot_velocity / sizeof(double)
};

/* c_0 + c_1 s + c_2 s^2 + ... as four independent sums in powers of s^4. */
static inline double polynomial(const double *coefficients, int count, double s)
{
    const double square = s * s, fourth = square * square;
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    for (int k = count - 1; k >= 0; k--) {
        sum[k % 4] = sum[k % 4] * fourth + coefficients[k];
    }
    return (sum[0] + s * sum[1]) + square * (sum[2] + s * sum[3]);
}

/* c_1 + 2 c_2 s + 3 c_3 s^2 + ... */
static inline double polynomial_slope(const double *coefficients, int count, double s)
{
    double value = 0.0;
    for (int k = count - 1; k >= 1; k--) {
        value = value * s + (double)k * coefficients[k];
    }
    return value;
}

static inline double size_of(double value)
{
    return value < 0.0 ? -value : value;
}

static inline double outer_share(const Parameters *p, double speed)
{
    const double apart = speed - p->curve_transition_speed, half = 0.5 * p->curve_transition_width;
    return apart >= half ? 1.0 : apart <= -half ? 0.0 : apart / p->curve_transition_width + 0.5;
}

static inline double inner_force(const Parameters *p, double v)
{
    const double s = v / p->curve_transition_speed;
    return s * polynomial(p->curve_inner, INNER, s);
}

static inline const double *outer_coefficients(const Parameters *p, double v)
{
    return v > 0.0 ? p->curve_compression : p->curve_rebound;
}

static inline double outer_force(const Parameters *p, double v)
{
    const double s = (size_of(v) - p->curve_transition_speed) / p->curve_transition_speed;
    return polynomial(outer_coefficients(p, v), OUTER, s);
}

static inline int has_knots(const Parameters *p)
{
    return p->curve_knot_velocity[KNOTS - 1] > 0.0;
}

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
    const double width = knots[k + 1] - knots[k];
    const Cell cell = {width, forces[k + 1] - forces[k], width * slopes[k], width * slopes[k + 1], (v - knots[k]) / width, forces[k]};
    return cell;
}

static inline double force_through_knots(const Parameters *p, double v)
{
    const Cell c = cell_at(p, v);
    return c.force + c.x * (c.start + c.x * ((3.0 * c.rise - 2.0 * c.start - c.end) + c.x * (c.start + c.end - 2.0 * c.rise)));
}

static inline double slope_through_knots(const Parameters *p, double v)
{
    const Cell c = cell_at(p, v);
    const double bend = 2.0 * (3.0 * c.rise - 2.0 * c.start - c.end), twist = 3.0 * (c.start + c.end - 2.0 * c.rise);
    return (c.start + c.x * (bend + c.x * twist)) / c.width;
}

static inline double fitted_force(const Parameters *p, double v)
{
    if (has_knots(p)) {
        return force_through_knots(p, v);
    }
    const double share = outer_share(p, size_of(v));
    if (share == 0.0) {
        return inner_force(p, v);
    }
    return share == 1.0 ? outer_force(p, v) : (1.0 - share) * inner_force(p, v) + share * outer_force(p, v);
}

static inline double fitted_slope(const Parameters *p, double v)
{
    if (has_knots(p)) {
        return slope_through_knots(p, v);
    }
    const double side = v > 0.0 ? 1.0 : -1.0, v_t = p->curve_transition_speed;
    const double share = outer_share(p, size_of(v)), s = v / v_t;
    const double inner = polynomial(p->curve_inner, INNER, s) + s * polynomial_slope(p->curve_inner, INNER, s);
    const double outer = side * polynomial_slope(outer_coefficients(p, v), OUTER, (size_of(v) - v_t) / v_t);
    const double slope = ((1.0 - share) * inner + share * outer) / v_t;
    return share > 0.0 && share < 1.0
               ? slope + side * (outer_force(p, v) - inner_force(p, v)) / p->curve_transition_width
               : slope;
}

static inline int is_beyond_fit(const Parameters *p, double v)
{
    return v > p->curve_compression_speed || v < -p->curve_rebound_speed;
}

static inline double curve_force(const Parameters *p, double v)
{
    const double high = p->curve_compression_speed, low = -p->curve_rebound_speed;
    if (v > high) {
        return fitted_force(p, high) + p->curve_compression_slope * (v - high);
    }
    if (v < low) {
        return fitted_force(p, low) + p->curve_rebound_slope * (v - low);
    }
    return fitted_force(p, v);
}

static inline double curve_slope(const Parameters *p, double v)
{
    if (is_beyond_fit(p, v)) {
        return v > 0.0 ? p->curve_compression_slope : p->curve_rebound_slope;
    }
    return fitted_slope(p, v);
}

static inline double scale(const Parameters *p, double v)
{
    return v > 0.0 ? p->compression_scale : p->rebound_scale;
}

/* F_s [N] with the port's scales. */
static inline double valve_force(const Parameters *p, double v)
{
    return scale(p, v) * curve_force(p, v);
}

static inline double valve_slope(const Parameters *p, double v)
{
    return scale(p, v) * curve_slope(p, v);
}

#endif
