/* A shock: static curve, lag, output weight, port; bit for bit as in eightpost/shock/{curve,law,port}.py, which the fit uses. */
#include "shock.h"

#include "curve.h"
#include "elementary.h"
#include "settings.h"

/* Largest change of damper velocity [m/s] over which F_s is treated as linear, and the maximum number of pieces in a step, as in
 * eightpost/shock/law.py. */
static const double STRAIGHT = 0.01;
enum { MOST_PIECES = 1000 };

/* Number of piece counts whose factors are kept: a step of one piece is often followed by one of two or three. */
enum { KEPT = 4 };

/* ---- A law with one state, in the form of a law with several -------------------------------------------------------------- */

#ifndef SEVERAL_STATES
static State law_start(const Parameters *p, double velocity, double static_force)
{
    const State state = {{static_force}};
    (void)p;
    (void)velocity;
    return state;
}

static double *law_state(Signals *s, int k)
{
    (void)k;
    return &s->lagged_force;
}

static void law_advance(const Parameters *p, LagFactors *kept, State *state, const Piece *piece)
{
    state->at[0] = law_advance_lag(p, kept, state->at[0], piece);
}

static double law_force(const Parameters *p, const State *state, double velocity, double static_force)
{
    (void)p;
    (void)velocity;
    (void)static_force;
    return state->at[0];
}

static Slopes law_slopes(const Parameters *p, const State *state, double velocity, double static_force)
{
    const double slope = valve_slope(p, velocity), alpha = law_lag_weight(p, static_force), lagged = state->at[0];
    const Rate rate = law_rate(p, lagged, static_force);
    const Slopes slopes = {
        .force_by_velocity = (1.0 - alpha) * slope + law_lag_weight_slope(p, static_force) * slope * (lagged - static_force),
        .force_by_state = {alpha},
        .rate = {rate.value},
        .rate_by_velocity = {rate.by_static * slope},
        .rate_by_state = {rate.by_lagged},
    };
    return slopes;
}
#endif

static State state_of(const Signals *s)
{
    Signals copy = *s;
    State state;
    for (int k = 0; k < STATE_COUNT; k++) {
        state.at[k] = *law_state(&copy, k);
    }
    return state;
}

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

/* F = r (alpha F_lag + (1 - alpha) F_s + seal + gas), the other outputs and the states; 0, without any change, if the result is
 * not finite. */
static int respond(Signals *s, const Parameters *p, const State *state, double f)
{
    const double v = p->motion_ratio * s->velocity, lagged = law_force(p, state, v, f);
    const double alpha = law_lag_weight(p, f);
    const double dissipative = alpha * lagged + (1.0 - alpha) * f + seal_force(p, v);
    const double force = p->motion_ratio * (dissipative + gas_force(p, s->displacement)), power = dissipative * v;
    if (!is_finite(force) || !is_finite(power)) {
        return 0;
    }
    for (int k = 0; k < STATE_COUNT; k++) {
        *law_state(s, k) = state->at[k];
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

/* Returns the states and F_s at the end of the piece. */
static void follow_piece(const Parameters *p, LagFactors *kept, State *state, double start, double end, double h, double *f)
{
    const double v = p->motion_ratio * end;
    const Piece piece = {p->motion_ratio * start, *f, v, end == start ? *f : valve_force(p, v), h};
    *f = piece.static_end;
    law_advance(p, kept, state, &piece);
}

/* Returns the states and F_s at the end of the step; F_s at its start is given. */
static void follow(const Parameters *p, LagFactors *kept, State *state, double start, double end, double h, double *f)
{
    const int count = pieces(p, start, end);
    const double part = count == 1 ? h : h / (double)count;
    double before = start;
    LagFactors *factors = &kept[STATE_COUNT * ((count < KEPT ? count : KEPT) - 1)];
    for (int k = 1; k < count; k++) {
        const double velocity = start + (end - start) * ((double)k / (double)count);
        follow_piece(p, factors, state, before, velocity, part, f);
        before = velocity;
    }
    follow_piece(p, factors, state, before, end, part, f);
}

/* ---- Functions declared in component.h: start and steps --------------------------------------------------------------- */

size_t model_work_size(void)
{
    return settings_size() + KEPT * STATE_COUNT * sizeof(LagFactors);
}

/* The factors of a lag that are kept; parameters at a setting come before them. */
static LagFactors *kept_factors(void *work)
{
    return (LagFactors *)(void *)((unsigned char *)work + settings_size());
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
    const Parameters *p = parameters_in_use(memory, work);
    (void)why;
    const double f = static_force(p, s->velocity);
    const State state = law_start(p, p->motion_ratio * s->velocity, f);
    memory->state[0] = s->velocity;
    report_setting(memory, work);
    return respond(s, p, &state, f);
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = parameters_in_use(memory, work);
    const double velocity = memory->state[0]; /* velocity of s->static_force */
    const int is_known = from[0] == velocity && !memory->stale && TEMPERATURE_INPUT < 0;
    double f = is_known ? s->static_force : static_force(p, from[0]);
    (void)why;
    State state = state_of(s);
    follow(p, kept_factors(work), &state, from[0], s->velocity, h, &f);
    if (!respond(s, p, &state, f)) {
        return 0;
    }
    memory->state[0] = s->velocity;
    report_setting(memory, work);
    return 1;
}

/* A step computes all outputs. */
double model_output(const Memory *memory, int output)
{
    return memory->values.at[INPUTS + output];
}

/* ---- Model exchange: the law's states are the continuous states ------------------------------------------------------ */

double *model_state(Memory *memory, int k)
{
    return law_state(&memory->values.named.signals, k);
}

int model_evaluate(Memory *memory, void *work, Message *why)
{
    Signals *s = &memory->values.named.signals;
    const Parameters *p = parameters_in_use(memory, work);
    const double f = static_force(p, s->velocity);
    (void)why;
    const State state = CONTINUOUS_STATES > 0 ? state_of(s) : law_start(p, p->motion_ratio * s->velocity, f);
    if (!respond(s, p, &state, f)) {
        return 0;
    }
    memory->state[0] = s->velocity;
    report_setting(memory, work);
    return 1;
}

void model_derivatives(const Memory *memory, void *work, double *rates)
{
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = parameters_in_use(memory, work);
    const State state = state_of(s);
    const Slopes slopes = law_slopes(p, &state, p->motion_ratio * memory->state[0], s->static_force);
    for (int k = 0; k < CONTINUOUS_STATES; k++) {
        rates[k] = slopes.rate[k];
    }
}

#if defined(HAS_SETTINGS) && defined(HAS_TEMPERATURE_INPUT)
/* Half of the change of temperature [K] over which a difference replaces the derivatives. */
static const double WARMER = 0.01;

/* Adds the changes of the force and of the derivatives for a change of the temperature [K]. */
static void add_warming(const Memory *memory, double change, double *outputs, double *rates)
{
    double force[2];
    Slopes slopes[2];
    for (int side = 0; side < 2; side++) {
        Memory other = *memory;
        Signals *s = &other.values.named.signals;
        double setting[AXES];
        s->temperature += side == 0 ? -WARMER : WARMER;
        read_setting(&other.values, setting);
        const Parameters p = parameters_at(&memory->values.named.parameters, setting);
        const double f = static_force(&p, s->velocity);
        const State state = CONTINUOUS_STATES > 0 ? state_of(s) : law_start(&p, p.motion_ratio * s->velocity, f);
        slopes[side] = law_slopes(&p, &state, p.motion_ratio * s->velocity, f);
        (void)respond(s, &p, &state, f);
        force[side] = s->force;
    }
    outputs[0] += (force[1] - force[0]) / (2.0 * WARMER) * change;
    for (int k = 0; k < CONTINUOUS_STATES && rates != NULL; k++) {
        rates[k] += (slopes[1].rate[k] - slopes[0].rate[k]) / (2.0 * WARMER) * change;
    }
}
#endif

/* The states change by `states`, and not with the inputs. */
void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates)
{
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = parameters_in_use(memory, work);
    const double r = p->motion_ratio, v = r * s->velocity, f = static_force(p, s->velocity);
    const State state = state_of(s);
    const Slopes slopes = law_slopes(p, &state, v, f);
    /* force is the only output */
    outputs[0] = r * r * (slopes.force_by_velocity + seal_slope(p, v)) * inputs[0] + r * r * p->gas_stiffness * inputs[1];
    for (int k = 0; k < STATE_COUNT; k++) {
        outputs[0] += r * slopes.force_by_state[k] * (states == NULL || k >= CONTINUOUS_STATES ? 0.0 : states[k]);
    }
    for (int k = 0; k < CONTINUOUS_STATES && rates != NULL; k++) {
        const double moved = states == NULL ? 0.0 : states[k];
        rates[k] = slopes.rate_by_state[k] * moved + slopes.rate_by_velocity[k] * r * inputs[0];
    }
#if defined(HAS_SETTINGS) && defined(HAS_TEMPERATURE_INPUT)
    add_warming(memory, inputs[TEMPERATURE_INPUT], outputs, rates);
#endif
}
