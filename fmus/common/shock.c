/* A shock: static curve, lag, output weight, port; bit for bit as in eightpost/shock/{curve,law,port}.py, which the fit uses. */
#include "shock.h"

#include "curve.h"
#include "elementary.h"

/* Largest change of damper velocity [m/s] over which F_s is treated as linear, and the maximum number of pieces in a step, as in
 * eightpost/shock/law.py. */
static const double STRAIGHT = 0.01;
enum { MOST_PIECES = 1000 };

/* Number of piece counts whose factors are kept: a step of one piece is often followed by one of two or three. */
enum { KEPT = 4 };

/* ---- The port ------------------------------------------------------------------------------------------------------- */

/* F_s [N] at a port velocity [m/s]. */
static double static_force(const Parameters *p, double velocity)
{
    return valve_force(p, p->motion_ratio * velocity);
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

/* F = r (alpha F_lag + (1 - alpha) F_s + seal + gas), and the other outputs; 0, without any change, if the result is not
 * finite. */
static int respond(Signals *s, const Parameters *p, double lagged, double f)
{
    const double v = p->motion_ratio * s->velocity;
    const double alpha = law_lag_weight(p, f);
    const double dissipative = alpha * lagged + (1.0 - alpha) * f + seal_force(p, v);
    const double force = p->motion_ratio * (dissipative + gas_force(p, s->displacement)), power = dissipative * v;
    if (!is_finite(force) || !is_finite(power)) {
        return 0;
    }
    s->force = force;
    s->static_force = f;
    s->lagged_force = lagged;
    s->lag_weight = alpha;
    s->dissipated_power = power;
    s->beyond_fit = is_beyond_fit(p, v) ? 1.0 : 0.0;
    return 1;
}

/* The number of linear pieces of F_s while the port velocity goes from start to end. */
static int pieces(const Parameters *p, double start, double end)
{
    const double change = size_of(p->motion_ratio * (end - start));
    if (!(change >= STRAIGHT)) { /* a short step, or NaN, for which the number of pieces does not matter */
        return 1;
    }
    const double count = change / STRAIGHT;
    return count < MOST_PIECES ? (int)count + 1 : MOST_PIECES;
}

/* Returns F_lag and F_s at the end of the piece. */
static double follow_piece(const Parameters *p, LagFactors *kept, double lagged, double start, double end, double h, double *f)
{
    const double v = p->motion_ratio * end;
    const Piece piece = {p->motion_ratio * start, *f, v, end == start ? *f : valve_force(p, v), h};
    *f = piece.static_end;
    return law_advance_lag(p, kept, lagged, &piece);
}

/* Returns F_lag and F_s at the end of the step; F_s at its start is given. */
static double follow(const Parameters *p, LagFactors *kept, double lagged, double start, double end, double h, double *f)
{
    const int count = pieces(p, start, end);
    const double part = count == 1 ? h : h / (double)count;
    double before = start;
    LagFactors *factors = &kept[(count < KEPT ? count : KEPT) - 1];
    for (int k = 1; k < count; k++) {
        const double velocity = start + (end - start) * ((double)k / (double)count);
        lagged = follow_piece(p, factors, lagged, before, velocity, part, f);
        before = velocity;
    }
    return follow_piece(p, factors, lagged, before, end, part, f);
}

/* ---- Functions declared in component.h: start and steps --------------------------------------------------------------- */

size_t model_work_size(void)
{
    return KEPT * sizeof(LagFactors);
}

static int are_zeros(const double *numbers)
{
    int zeros = 1;
    for (int k = 0; k < KNOTS; k++) {
        zeros &= numbers[k] == 0.0;
    }
    return zeros;
}

static int is_ascending(const double *knots)
{
    int ascending = 1;
    for (int k = 1; k < KNOTS; k++) {
        ascending &= knots[k - 1] < knots[k];
    }
    return ascending;
}

/* The reason why the knots are not those of a curve, as in StaticCurve, or NULL. No slope is negative, because of its range. */
static const char *knots_refused(const Parameters *p)
{
    const double *knots = p->curve_knot_velocity;
    if (are_zeros(knots)) {
        return are_zeros(p->curve_knot_force) && are_zeros(p->curve_knot_slope)
                   ? NULL
                   : "curve.knot_force and curve.knot_slope are given, but curve.knot_velocity is all zeros";
    }
    if (!is_ascending(knots)) {
        return "curve.knot_velocity must be ascending";
    }
    if (knots[KNOTS / 2] != 0.0 || p->curve_knot_force[KNOTS / 2] != 0.0) {
        return "the middle knot of the curve must be at zero velocity and zero force";
    }
    return knots[0] == -p->curve_rebound_speed && knots[KNOTS - 1] == p->curve_compression_speed
               ? NULL
               : "curve.knot_velocity must begin at -curve.rebound_speed and end at curve.compression_speed";
}

int model_refuses(const Values *v, Message *why)
{
    const Parameters *p = &v->named.parameters;
    const char *reason = knots_refused(p);
    if (reason == NULL) {
        reason = law_refuses(p);
    }
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
    memory->state[0] = s->velocity;
    return respond(s, p, f, f);
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    const double velocity = memory->state[0]; /* velocity of s->static_force */
    double f = from[0] == velocity && !memory->stale ? s->static_force : static_force(p, from[0]);
    (void)why;
    const double lagged = follow(p, (LagFactors *)work, s->lagged_force, from[0], s->velocity, h, &f);
    if (!respond(s, p, lagged, f)) {
        return 0;
    }
    memory->state[0] = s->velocity;
    return 1;
}

/* A step computes all outputs. */
double model_output(const Memory *memory, int output)
{
    return memory->values.at[INPUTS + output];
}

/* ---- Model exchange: F_lag is the continuous state ------------------------------------------------------------------ */

double *model_state(Memory *memory, int k)
{
    (void)k;
    return &memory->values.named.signals.lagged_force;
}

int model_evaluate(Memory *memory, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    const double f = static_force(p, s->velocity);
    (void)work;
    (void)why;
    if (!respond(s, p, CONTINUOUS_STATES > 0 ? s->lagged_force : f, f)) {
        return 0;
    }
    memory->state[0] = s->velocity;
    return 1;
}

void model_derivatives(const Memory *memory, void *work, double *rates)
{
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    (void)work;
    for (int k = 0; k < CONTINUOUS_STATES; k++) { /* there is one, or none */
        rates[k] = law_rate(p, s->lagged_force, p->motion_ratio * memory->state[0], s->static_force).value;
    }
}

/* F_lag changes by states[0], and not with the inputs. */
void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates)
{
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    const double r = p->motion_ratio, v = r * s->velocity, f = static_force(p, s->velocity);
    const double f_slope = valve_slope(p, v), alpha = law_lag_weight(p, f), moved = states == NULL ? 0.0 : states[0];
    const double by_velocity = (1.0 - alpha) * f_slope + law_lag_weight_slope(p, f) * f_slope * (s->lagged_force - f);
    (void)work;
    outputs[0] = r * r * (by_velocity + seal_slope(p, v)) * inputs[0] + r * r * p->gas_stiffness * inputs[1] +
                 r * alpha * moved; /* force is the only output */
    for (int k = 0; k < CONTINUOUS_STATES && rates != NULL; k++) {
        const Rate rate = law_rate(p, s->lagged_force, v, f);
        rates[k] = rate.by_lagged * moved + (rate.by_velocity + rate.by_static * f_slope) * r * inputs[0];
    }
}
