/* A shock: static curve, lag, output weight, port. The same operations in the same order as eightpost/shock/{curve,law,
 * port}.py, which the fit uses. */
#include "shock.h"

#include "elementary.h"

#define COUNT_OF(array) ((int)(sizeof(array) / sizeof *(array)))

/* Largest change of damper velocity [m/s] over which F_s is taken as a straight line, and the most pieces in a step:
 * eightpost/shock/law.py. */
static const double STRAIGHT = 0.01;
enum { MOST_PIECES = 1000 };

/* c_0 + c_1 s + c_2 s^2 + ... */
static double polynomial(const double *coefficients, int count, double s)
{
    double value = 0.0;
    for (int k = count - 1; k >= 0; k--) {
        value = value * s + coefficients[k];
    }
    return value;
}

/* c_1 + 2 c_2 s + 3 c_3 s^2 + ... */
static double polynomial_slope(const double *coefficients, int count, double s)
{
    double value = 0.0;
    for (int k = count - 1; k >= 1; k--) {
        value = value * s + (double)k * coefficients[k];
    }
    return value;
}

static double within(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static double size_of(double value)
{
    return value < 0.0 ? -value : value;
}

/* ---- The static curve F_s = f(v) (Eq 3.23), v the damper velocity --------------------------------------------------- */

static double outer_share(const Parameters *p, double speed)
{
    return within((speed - p->curve_transition_speed) / p->curve_transition_width + 0.5, 0.0, 1.0);
}

static double inner_force(const Parameters *p, double v)
{
    const double s = v / p->curve_transition_speed;
    return s * polynomial(p->curve_inner, COUNT_OF(p->curve_inner), s);
}

static const double *outer_coefficients(const Parameters *p, double v)
{
    return v > 0.0 ? p->curve_compression : p->curve_rebound;
}

static double outer_force(const Parameters *p, double v)
{
    const double s = (size_of(v) - p->curve_transition_speed) / p->curve_transition_speed;
    return polynomial(outer_coefficients(p, v), COUNT_OF(p->curve_compression), s);
}

static double fitted_force(const Parameters *p, double v)
{
    const double share = outer_share(p, size_of(v));
    const double inner = share < 1.0 ? inner_force(p, v) : 0.0;
    const double outer = share > 0.0 ? outer_force(p, v) : 0.0;
    return (1.0 - share) * inner + share * outer;
}

static double fitted_slope(const Parameters *p, double v)
{
    const double side = v > 0.0 ? 1.0 : -1.0, v_t = p->curve_transition_speed;
    const double share = outer_share(p, size_of(v)), s = v / v_t;
    const double inner = polynomial(p->curve_inner, COUNT_OF(p->curve_inner), s) + s * polynomial_slope(p->curve_inner, COUNT_OF(p->curve_inner), s);
    const double outer = side * polynomial_slope(outer_coefficients(p, v), COUNT_OF(p->curve_compression), (size_of(v) - v_t) / v_t);
    const double slope = ((1.0 - share) * inner + share * outer) / v_t;
    return share > 0.0 && share < 1.0
               ? slope + side * (outer_force(p, v) - inner_force(p, v)) / p->curve_transition_width
               : slope;
}

static int is_beyond_fit(const Parameters *p, double v)
{
    return v > p->curve_compression_speed || v < -p->curve_rebound_speed;
}

static double curve_force(const Parameters *p, double v)
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

static double curve_slope(const Parameters *p, double v)
{
    if (is_beyond_fit(p, v)) {
        return v > 0.0 ? p->curve_compression_slope : p->curve_rebound_slope;
    }
    return fitted_slope(p, v);
}

/* ---- The port ------------------------------------------------------------------------------------------------------- */

static double scale(const Parameters *p, double v)
{
    return v > 0.0 ? p->compression_scale : p->rebound_scale;
}

/* F_s [N] at a port velocity [m/s]. */
static double static_force(const Parameters *p, double velocity)
{
    const double v = p->motion_ratio * velocity;
    return scale(p, v) * curve_force(p, v);
}

static double seal_force(const Parameters *p, double v)
{
    return p->seal_friction == 0.0 ? 0.0 : p->seal_friction * hyperbolic_tangent(v / p->friction_velocity);
}

static double seal_slope(const Parameters *p, double v)
{
    const double t = hyperbolic_tangent(v / p->friction_velocity);
    return p->seal_friction / p->friction_velocity * (1.0 - t * t);
}

static double gas_force(const Parameters *p, double displacement)
{
    return p->gas_preload + p->gas_stiffness * p->motion_ratio * displacement;
}

/* F = r (alpha F_lag + (1 - alpha) F_s + seal + gas), and what else the FMU tells. */
static void respond(Signals *s, const Parameters *p, double lagged, double f)
{
    const double v = p->motion_ratio * s->velocity;
    const double alpha = law_lag_weight(p, f);
    const double dissipative = alpha * lagged + (1.0 - alpha) * f + seal_force(p, v);
    s->force = p->motion_ratio * (dissipative + gas_force(p, s->displacement));
    s->static_force = f;
    s->lagged_force = lagged;
    s->lag_weight = alpha;
    s->dissipated_power = dissipative * v;
    s->beyond_fit = is_beyond_fit(p, v) ? 1.0 : 0.0;
}

/* In how many straight pieces F_s is followed while the port velocity goes from start to end. */
static int pieces(const Parameters *p, double start, double end)
{
    const double count = size_of(p->motion_ratio * (end - start)) / STRAIGHT;
    return count < 1.0 ? 1 : count >= MOST_PIECES ? MOST_PIECES : (int)count + 1;
}

/* Returns F_lag at the end of the step, and F_s there; F_s at its start is given. */
static double follow(const Parameters *p, double lagged, double start, double end, double h, double *f)
{
    const int count = pieces(p, start, end);
    double before = *f;
    for (int k = 1; k <= count; k++) {
        const double velocity = k == count ? end : start + (end - start) * ((double)k / (double)count);
        *f = velocity == start ? before : static_force(p, velocity);
        lagged = law_advance_lag(p, lagged, before, *f, h / (double)count);
        before = *f;
    }
    return lagged;
}

/* ---- What component.h asks of a model ------------------------------------------------------------------------------- */

size_t model_work_size(void)
{
    return 0;
}

int model_refuses(const Values *v, Message *why)
{
    const Parameters *p = &v->named.parameters;
    const char *reason = law_refuses(p);
    if (reason == NULL && p->curve_transition_width >= 2.0 * p->curve_transition_speed) {
        reason = "curve.transition_width must be less than twice curve.transition_speed: the curve must pass through zero "
                 "at zero velocity";
    }
    if (reason != NULL) {
        say(why, reason);
    }
    return reason != NULL;
}

int model_warns(const Values *v, Message *why)
{
    const double ratio = v->named.parameters.motion_ratio;
    if (ratio > 1.5) {
        say(why, "motion_ratio = ");
        say_number(why, ratio);
        say(why, " is above 1.5: is it port travel per damper travel?");
    }
    return ratio > 1.5;
}

int model_start(Memory *memory, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    (void)work;
    (void)why;
    const double f = static_force(p, s->velocity);
    respond(s, p, f, f);
    memory->state[0] = s->velocity;
    return 1;
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    double *velocity = &memory->state[0]; /* of s->static_force */
    double f = from[0] == *velocity && !memory->stale ? s->static_force : static_force(p, from[0]);
    (void)work;
    (void)why;
    const double lagged = follow(p, s->lagged_force, from[0], s->velocity, h, &f);
    respond(s, p, lagged, f);
    *velocity = s->velocity;
    return is_finite(s->force) && is_finite(s->dissipated_power);
}

/* A step computes all outputs. */
void model_output(Memory *memory, int output)
{
    (void)memory;
    (void)output;
}

/* d force / d velocity with F_lag held, or d force / d displacement. */
double model_direct_term(const Memory *memory, int output, int input)
{
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    const double r = p->motion_ratio, v = r * s->velocity, f = static_force(p, s->velocity);
    const double f_slope = scale(p, v) * curve_slope(p, v), alpha = law_lag_weight(p, f);
    (void)output; /* force is the only one */
    if (input != 0) {
        return r * r * p->gas_stiffness;
    }
    return r * r * ((1.0 - alpha) * f_slope + law_lag_weight_slope(p, f) * f_slope * (s->lagged_force - f) + seal_slope(p, v));
}
