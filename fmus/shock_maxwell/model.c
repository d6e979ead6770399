/* Maxwell: the static curve and a stiffness in series, dF/dt = k (v - w), F = f(w). The same operations in the same order as in
 * eightpost/shock/maxwell.py, which the fit uses. Velocities are those of the damper. */
#include "curve.h"
#include "lag.h"
#include "shock.h"

/* Constants of maxwell.py, law.py and curve.py: largest change of w [m/s] over which the curve is treated as straight; shortest
 * chord and first step of the search [m/s]; number of time constants after which the start of a lag has no effect, and almost none;
 * accuracy of a force; accuracy of a time constant, and smallest slope of a secant that is used; size of a Newton step that ends
 * the search; relative rounding error of a force; maximum numbers of parts of a piece, corrections of a chord and steps of the
 * search; numbers of places checked on a side and in a transition. */
static const double CHORD = 0.01, SHORTEST = 1e-9, FIRST = 1e-3, SETTLED = 1000.0, AT_REST = 40.0, FOUND = 4e-16;
static const double AGREEMENT = 1e-5, LEAST_BEND = 0.2, NEAR = 1e-9, FORCE_ROUNDING = 1e-9;
enum { MOST_PARTS = 1000, MOST_CORRECTIONS = 10, MOST_TRIES = 100, LOOKS = 256, TRANSITION_LOOKS = 12 };

static double signed_like(double size, double sign)
{
    return sign < 0.0 ? -size : size;
}

static double larger(double a, double b)
{
    return b > a ? b : a;
}

static double smaller(double a, double b)
{
    return b < a ? b : a;
}

/* w with f(w) = force, from a guess with its force: secants inside a bracket. */
static double velocity_under(const Parameters *p, double force, double guess, double guess_force)
{
    double before = guess, before_miss = guess_force - force;
    if (before_miss == 0.0) {
        return guess;
    }
    double low = before_miss > 0.0 ? -NO_LIMIT : guess, high = before_miss > 0.0 ? guess : NO_LIMIT;
    double here = guess - signed_like(FIRST, before_miss);
    for (int tries = 0; tries < MOST_TRIES; tries++) {
        const double miss = valve_force(p, here) - force;
        if (size_of(miss) <= FOUND * size_of(force) || miss == before_miss || here == before) {
            return here;
        }
        if (miss > 0.0) {
            high = smaller(high, here);
        } else {
            low = larger(low, here);
        }
        double there = here - miss * (here - before) / (miss - before_miss);
        if (!(low < there && there < high)) {
            there = high - low < NO_LIMIT ? 0.5 * (low + high) : here + 2.0 * (here - before);
        }
        before = here;
        before_miss = miss;
        here = there;
    }
    return here;
}

/* ---- dF/dt = k (v - w) over a piece in which v is linear --------------------------------------------------------------- */

static double velocity_at(const Piece *piece, double time)
{
    return piece->velocity_start + (piece->velocity_end - piece->velocity_start) * (time / piece->step);
}

static double reach(double w, double v, double end)
{
    return larger(size_of(v - w), size_of(end - w));
}

/* The slope of the chord from w, where F = force, for a change of w, divided by k. */
static double time_constant_over(const Parameters *p, double w, double force, double change)
{
    const double there = w + (size_of(change) > SHORTEST ? change : signed_like(SHORTEST, change));
    return larger((valve_force(p, there) - force) / (there - w) / p->series_stiffness, 0.0);
}

static double followed(double w, double v, double end, double tau, double h)
{
    LagFactors none = {0.0, 0.0, 0.0, 0.0};
    return h >= SETTLED * tau ? end - (end - v) * (tau / h) : advance_lag(&none, w, v, end, tau, h);
}

/* The distance [m/s] from w to the next kink of the curve in a direction; NO_LIMIT if none follows. */
static double room_before_kink(const Parameters *p, double w, double towards)
{
    const double half = 0.5 * p->curve_transition_width;
    const double inside = p->curve_transition_speed - half, outside = p->curve_transition_speed + half;
    const double kinks[] = {0.0, -p->curve_rebound_speed, p->curve_compression_speed, -outside, -inside, inside, outside};
    const int count = has_knots(p) ? 3 : (int)(sizeof kinks / sizeof kinks[0]); /* a spline has no transition */
    double room = NO_LIMIT;
    for (int k = p->compression_scale == p->rebound_scale; k < count; k++) {
        const double distance = towards < 0.0 ? w - kinks[k] : kinks[k] - w;
        room = distance > SHORTEST && distance < room ? distance : room;
    }
    return room;
}

/* The time constant of the chord from w to its value after h, or to the kink at a distance `room`. The search starts from a nearby
 * tau and continues by secants until tau is that of the chord to the resulting w. */
static double chord_time_constant(const Parameters *p, double w, double force, double tau, double v, double end, double h,
                                  double room)
{
    double before = tau, miss_before = 0.0;
    for (int tries = 0; tries < MOST_CORRECTIONS; tries++) {
        const double change = followed(w, v, end, tau, h) - w;
        if (change == 0.0) {
            return tau;
        }
        const double found = time_constant_over(p, w, force, signed_like(smaller(size_of(change), room), change));
        const double miss = found - tau;
        const double bend = tries == 0 ? 0.0 : (miss_before - miss) / (tau - before);
        const double after = bend > LEAST_BEND ? tau + miss / bend : found;
        before = tau;
        miss_before = miss;
        tau = larger(after, 0.0);
        if (size_of(miss) <= AGREEMENT * found) {
            return tau;
        }
    }
    return tau;
}

/* The correction to a change of w for the curve's deviation from its chord: a parabola, with w changing at an even rate. */
static double bow_of_curve(const Parameters *p, double w, double force, double change, double tau, double h)
{
    const double stiffness = p->series_stiffness;
    const double bow = valve_force(p, w + 0.5 * change) - (force + 0.5 * stiffness * tau * change);
    return 4.0 * bow * h / (stiffness * (6.0 * tau * tau + 3.0 * tau * h + h * h));
}

/* The time after which w has moved by `room`; after h it has moved by `change`. Newton's method inside a bracket: w is monotonic
 * and either convex or concave in time. */
static double time_across(double room, double change, double w, double v, double end, double tau, double h)
{
    double low = 0.0, high = h, time = h * (room / change);
    for (int tries = 0; tries < MOST_TRIES; tries++) {
        const double here = v + (end - v) * (time / h), after = followed(w, v, here, tau, time);
        const double miss = size_of(after - w) - room, rate = size_of(here - after);
        if (miss > 0.0) {
            high = time;
        } else {
            low = time;
        }
        double there = rate > 0.0 ? time - miss * tau / rate : low;
        const int is_newton = low < there && there < high;
        if (!is_newton) {
            there = 0.5 * (low + high);
        }
        if (size_of(there - time) <= (is_newton ? NEAR : FOUND) * h) {
            return there;
        }
        time = there;
    }
    return time;
}

/* The time of a crossing at which w is ahead by `gained` and changes at the rate gap / tau; not reduced by more than half: where w
 * barely changes, this linear estimate is not valid. */
static double time_less_bow(double time, double gained, double tau, double gap)
{
    const double earlier = gained * tau;
    return size_of(earlier) < 0.5 * size_of(gap) * time ? time - earlier / gap : time;
}

static double advance_force(const Parameters *p, double lagged, const Piece *piece)
{
    double w = velocity_under(p, lagged, piece->velocity_start, piece->static_start), force = lagged, time = 0.0;
    const double most = larger(CHORD, 2.0 * reach(w, piece->velocity_start, piece->velocity_end) / MOST_PARTS);
    for (int part = 0; part < MOST_PARTS; part++) {
        const double v = velocity_at(piece, time), gap = v - w;
        double left = piece->step - time, last = piece->velocity_end - w;
        if ((gap == 0.0 && last == 0.0) || left <= 0.0) {
            return force;
        }
        if (gap * last < 0.0 && size_of(gap) > SHORTEST) { /* w will turn: first advance to where v = w */
            left *= gap / (gap - last);
            last = 0.0;
        }
        const double towards = size_of(gap) >= size_of(last) ? gap : last;
        const double far = size_of(towards), room = room_before_kink(p, w, towards);
        double tau = time_constant_over(p, w, force, signed_like(smaller(smaller(far, most), room), towards));
        if (far > most && part < MOST_PARTS - 1) {
            if (tau == 0.0) { /* the curve is flat, so w crosses it at once */
                w += signed_like(smaller(most, room), towards);
                force = valve_force(p, w);
                continue;
            }
            left = smaller(left, tau * most / far); /* |dw/dt| is at most far / tau */
        }
        const double end = time + left >= piece->step ? piece->velocity_end : velocity_at(piece, time + left);
        tau = chord_time_constant(p, w, force, tau, v, end, left, room);
        double change = followed(w, v, end, tau, left) - w;
        if (size_of(change) > room) {
            const double whole = left;
            left = time_across(room, size_of(change), w, v, end, tau, whole);
            change = signed_like(room, change);
            const double gained = bow_of_curve(p, w, force, change, tau, left);
            left = smaller(time_less_bow(left, gained, tau, v + (end - v) * (left / whole) - (w + change)), whole);
        } else {
            /* Once w follows the velocity at a constant distance, only the velocity's ramp changes w at an even rate. */
            const double ramp = smaller(size_of(end - v) / larger(size_of(change), SHORTEST), 1.0);
            change += (left < AT_REST * tau ? 1.0 : ramp) * bow_of_curve(p, w, force, change, tau, left);
        }
        double after = w + signed_like(smaller(size_of(change), room), change);
        after = smaller(larger(after, smaller(smaller(w, v), end)), larger(larger(w, v), end));
        change = valve_force(p, after) - force;
        const double most_change = p->series_stiffness * left * far + FORCE_ROUNDING * size_of(force); /* |dF/dt| <= k far */
        if (size_of(change) > most_change) { /* the curve falls a little here, and w crosses the dip at once */
            after = velocity_under(p, force + signed_like(most_change, change), w, force);
        }
        w = after;
        force = valve_force(p, w);
        time = time + left >= piece->step ? piece->step : time + left;
    }
    return force;
}

/* ---- Functions declared in shock.h ------------------------------------------------------------------------------------- */

/* alpha = 1: the spring transmits the whole force of the valves. */
double law_lag_weight(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 1.0;
}

double law_lag_weight_slope(const Parameters *p, double static_force)
{
    (void)p;
    (void)static_force;
    return 0.0;
}

double law_advance_lag(const Parameters *p, LagFactors *kept, double lagged, const Piece *piece)
{
    (void)kept;
    return advance_force(p, lagged, piece);
}

/* dF/dt = k (v - w) with f(w) = F, and so dw/dF = 1 / f'(w). */
Rate law_rate(const Parameters *p, double lagged, double velocity, double static_force)
{
    const double w = velocity_under(p, lagged, velocity, static_force), k = p->series_stiffness;
    const Rate rate = {k * (velocity - w), -k / valve_slope(p, w), k, 0.0};
    return rate;
}

static int rises_between(const Parameters *p, double side, double slow, double fast)
{
    return side * (curve_force(p, side * fast) - curve_force(p, side * slow)) > 0.0;
}

/* Checked at equal steps of each cell between the knots of a side. */
static int rises_through_knots(const Parameters *p, double side)
{
    const int step = side > 0.0 ? 1 : -1;
    for (int k = KNOTS / 2; k + step >= 0 && k + step < KNOTS; k += step) {
        const double slow = side * p->curve_knot_velocity[k], width = side * p->curve_knot_velocity[k + step] - slow;
        for (int look = 0; look < TRANSITION_LOOKS; look++) {
            const double near = slow + width * ((double)look / (double)TRANSITION_LOOKS);
            if (!rises_between(p, side, near, slow + width * ((double)(look + 1) / (double)TRANSITION_LOOKS))) {
                return 0;
            }
        }
    }
    return 1;
}

/* Checked at equal steps of a side and of its transition, or between the knots, as in StaticCurve.falls_at. */
static int rises(const Parameters *p, double side, double speed)
{
    if (has_knots(p)) {
        return rises_through_knots(p, side);
    }
    for (int k = 0; k < LOOKS; k++) {
        if (!rises_between(p, side, speed * ((double)k / (double)LOOKS), speed * ((double)(k + 1) / (double)LOOKS))) {
            return 0;
        }
    }
    for (int k = 0; k < TRANSITION_LOOKS; k++) {
        const double middle = p->curve_transition_speed, width = p->curve_transition_width;
        const double slow = middle + width * ((double)k / (double)TRANSITION_LOOKS - 0.5);
        const double fast = middle + width * ((double)(k + 1) / (double)TRANSITION_LOOKS - 0.5);
        if (fast <= speed && !rises_between(p, side, slow, fast)) {
            return 0;
        }
    }
    return 1;
}

/* w follows from F only if the curve rises everywhere. */
const char *law_refuses(const Parameters *p)
{
    if (p->compression_scale <= 0.0 || p->rebound_scale <= 0.0) {
        return "compression_scale and rebound_scale must be positive for a Maxwell law, whose curve must rise everywhere";
    }
    if (!rises(p, 1.0, p->curve_compression_speed)) {
        return "the curve does not rise everywhere in compression, as a Maxwell law requires";
    }
    if (!rises(p, -1.0, p->curve_rebound_speed)) {
        return "the curve does not rise everywhere in rebound, as a Maxwell law requires";
    }
    return p->curve_compression_slope > 0.0 && p->curve_rebound_slope > 0.0
               ? NULL
               : "curve.compression_slope and curve.rebound_slope must be positive for a Maxwell law";
}
