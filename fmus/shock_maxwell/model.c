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

static inline real signed_like(real size, real sign)
{
    return either(sign < 0.0, -size, size);
}

static inline real larger(real a, real b)
{
    return either(b > a, b, a);
}

static inline real smaller(real a, real b)
{
    return either(b < a, b, a);
}

/* w with f(w) = force, from a guess with its force: secants inside a bracket. Where it is not `needed`, the guess. */
static real velocity_under(const Parameters *p, real force, real guess, real guess_force, truth needed)
{
    real before = guess, before_miss = guess_force - force;
    truth going = both_of(needed, before_miss != 0.0);
    real low = either(before_miss > 0.0, uniform(-NO_LIMIT), guess), high = either(before_miss > 0.0, guess, uniform(NO_LIMIT));
    real here = either(going, guess - signed_like(uniform(FIRST), before_miss), guess);
    for (int tries = 0; tries < MOST_TRIES && in_any(going); tries++) {
        const real miss = valve_force(p, here) - force;
        going &= is_false(one_of(one_of(size_of(miss) <= FOUND * size_of(force), miss == before_miss), here == before));
        if (!in_any(going)) {
            break;
        }
        high = either(miss > 0.0, smaller(high, here), high);
        low = either(miss > 0.0, low, larger(low, here));
        real there = here - miss * (here - before) / (miss - before_miss);
        const truth is_inside = both_of(low < there, there < high);
        if (!in_every(is_inside)) {
            const real other = either(high - low < NO_LIMIT, 0.5 * (low + high), here + 2.0 * (here - before));
            there = either(is_inside, there, other);
        }
        before = here;
        before_miss = miss;
        here = either(going, there, here);
    }
    return here;
}

/* ---- dF/dt = k (v - w) over a piece in which v is linear --------------------------------------------------------------- */

static inline real velocity_at(const Piece *piece, real time)
{
    return piece->velocity_start + (piece->velocity_end - piece->velocity_start) * (time / piece->step);
}

static inline real reach(real w, real v, real end)
{
    return larger(size_of(v - w), size_of(end - w));
}

/* A time in which w changes by at most `change` while v - w grows from gap to far over `left`. |dw/dt| is at most far / tau, and
 * until the gap has doubled on average at most 1.5 gap / tau; w never passes v. */
static inline real time_for(real change, real gap, real far, real left, real tau)
{
    const real from = larger(gap, uniform(SHORTEST)), growth = larger(far - from, uniform(SHORTEST)) / left;
    const real lagging = larger(tau * change / far, smaller(tau * change / (1.5 * from), from / growth));
    return larger(lagging, (change - from) / growth);
}

/* The slope of the chord from w, where F = force, for a change of w, divided by k. */
static inline real time_constant_over(const Parameters *p, real w, real force, real change)
{
    const real there = w + either(size_of(change) > SHORTEST, change, signed_like(uniform(SHORTEST), change));
    return larger((valve_force(p, there) - force) / (there - w) / p->series_stiffness, uniform(0.0));
}

static inline real followed(real w, real v, real end, real tau, real h)
{
    const truth is_settled = h >= SETTLED * tau;
    const real steady = end - (end - v) * (tau / h);
    if (in_every(is_settled)) {
        return steady;
    }
    return either(is_settled, steady, lag_after(w, v, end, either(is_settled, uniform(1.0), h / tau)));
}

/* The distance [m/s] from w to the next kink of the curve in a direction; NO_LIMIT if none follows. */
static inline real room_before_kink(const Parameters *p, real w, real towards)
{
    const real half = 0.5 * p->curve_transition_width;
    const real inside = p->curve_transition_speed - half, outside = p->curve_transition_speed + half;
    const real kinks[] = {uniform(0.0), -p->curve_rebound_speed, p->curve_compression_speed, -outside, -inside, inside, outside};
    const truth has_transition = is_false(has_knots(p)), changes_scale = is_false(p->compression_scale == p->rebound_scale);
    real room = uniform(NO_LIMIT);
    for (int k = in_any(changes_scale) ? 0 : 1; k < (in_any(has_transition) ? 7 : 3); k++) {
        const real distance = either(towards < 0.0, w - kinks[k], kinks[k] - w);
        const truth is_next = both_of(distance > SHORTEST, distance < room);
        const truth counts = k == 0 ? changes_scale : k < 3 ? is_next : has_transition;
        room = either(both_of(is_next, counts), distance, room);
    }
    return room;
}

/* The time constant of the chord from w to its value after h, or to the kink at a distance `room`. The search starts from a nearby
 * tau and continues by secants until tau is that of the chord to the resulting w. */
static inline real chord_time_constant(const Parameters *p, real w, real force, real tau, real v, real end, real h, real room,
                                       truth needed)
{
    real before = tau, miss_before = uniform(0.0);
    truth going = needed;
    for (int tries = 0; tries < MOST_CORRECTIONS; tries++) {
        const real change = followed(w, v, end, tau, h) - w;
        going &= change != 0.0;
        if (!in_any(going)) {
            break;
        }
        const real found = time_constant_over(p, w, force, signed_like(smaller(size_of(change), room), change));
        const real miss = found - tau, bend = tries == 0 ? uniform(0.0) : (miss_before - miss) / (tau - before);
        const real after = either(bend > LEAST_BEND, tau + miss / bend, found);
        before = tau;
        miss_before = miss;
        tau = either(going, larger(after, uniform(0.0)), tau);
        going &= is_false(size_of(miss) <= AGREEMENT * found);
        if (!in_any(going)) {
            break;
        }
    }
    return tau;
}

/* The correction to a change of w for the curve's deviation from its chord: a parabola, with w changing at an even rate. */
static inline real bow_of_curve(const Parameters *p, real w, real force, real change, real tau, real h)
{
    const real stiffness = p->series_stiffness;
    const real bow = valve_force(p, w + 0.5 * change) - (force + 0.5 * stiffness * tau * change);
    return 4.0 * bow * h / (stiffness * (6.0 * tau * tau + 3.0 * tau * h + h * h));
}

/* The time after which w has moved by `room`; after h it has moved by `change`. Newton's method inside a bracket: w is monotonic
 * and either convex or concave in time. */
static APART real time_across(real room, real change, real w, real v, real end, real tau, real h, truth needed)
{
    real low = uniform(0.0), high = h, time = h * (room / change);
    truth going = needed;
    for (int tries = 0; tries < MOST_TRIES && in_any(going); tries++) {
        const real here = v + (end - v) * (time / h), after = followed(w, v, here, tau, time);
        const real miss = size_of(after - w) - room, rate = size_of(here - after);
        high = either(miss > 0.0, time, high);
        low = either(miss > 0.0, low, time);
        real there = either(rate > 0.0, time - miss * tau / rate, low);
        const truth is_newton = both_of(low < there, there < high);
        there = either(is_newton, there, 0.5 * (low + high));
        const truth is_found = size_of(there - time) <= either(is_newton, uniform(NEAR), uniform(FOUND)) * h;
        time = either(going, there, time);
        going &= is_false(is_found);
    }
    return time;
}

/* The time of a crossing at which w is ahead by `gained` and changes at the rate gap / tau; not reduced by more than half: where w
 * barely changes, this linear estimate is not valid. */
static inline real time_less_bow(real time, real gained, real tau, real gap)
{
    const real earlier = gained * tau;
    return either(size_of(earlier) < 0.5 * size_of(gap) * time, time - earlier / gap, time);
}

/* A part of a piece, which begins at w: the velocities at its ends, its duration, and how far w may move. */
typedef struct {
    real v, end, left, room;
} Part;

/* The change of w over a part with a time constant. Where w reaches a kink, the part ends there. */
static inline real change_over(const Parameters *p, real w, real force, real tau, Part *part, truth needed)
{
    const real v = part->v, end = part->end, left = part->left, room = part->room;
    const real change = followed(w, v, end, tau, left) - w;
    const truth crosses = both_of(needed, size_of(change) > room);
    real to_kink = change, bent = change;
    if (in_any(crosses)) {
        const real time = time_across(room, size_of(change), w, v, end, tau, left, crosses);
        to_kink = signed_like(room, change);
        const real gained = bow_of_curve(p, w, force, to_kink, tau, time);
        const real less = time_less_bow(time, gained, tau, v + (end - v) * (time / left) - (w + to_kink));
        part->left = either(crosses, smaller(less, left), left);
    }
    if (!in_every(crosses)) {
        /* Once w follows the velocity at a constant distance, only the velocity's ramp changes w at an even rate. */
        const real ramp = smaller(size_of(end - v) / larger(size_of(change), uniform(SHORTEST)), uniform(1.0));
        bent = change + either(left < AT_REST * tau, uniform(1.0), ramp) * bow_of_curve(p, w, force, change, tau, left);
    }
    return either(crosses, to_kink, bent);
}

/* The force after a piece; where it is not `needed`, that before. */
static real advance_force(const Parameters *p, real lagged, const Piece *piece, truth needed)
{
    real w = velocity_under(p, lagged, piece->velocity_start, piece->static_start, needed), force = lagged, time = uniform(0.0);
    const real most = larger(uniform(CHORD), 6.0 * reach(w, piece->velocity_start, piece->velocity_end) / (double)MOST_PARTS);
    truth going = needed;
    for (int count = 0; count < MOST_PARTS; count++) {
        const real v = velocity_at(piece, time), gap = v - w;
        real left = piece->step - time, last = piece->velocity_end - w;
        going &= is_false(one_of(both_of(gap == 0.0, last == 0.0), left <= 0.0));
        if (!in_any(going)) {
            break;
        }
        const truth turns = both_of(gap * last < 0.0, size_of(gap) > SHORTEST); /* first advance to where v = w */
        left = either(turns, left * (gap / (gap - last)), left);
        last = either(turns, uniform(0.0), last);
        const real towards = either(size_of(gap) >= size_of(last), gap, last), far = size_of(towards);
        const real room = room_before_kink(p, w, towards);
        const real nearby = time_constant_over(p, w, force, signed_like(smaller(smaller(far, most), room), towards));
        truth moves = going;
        if (count < MOST_PARTS - 1 && in_any(far > most)) {
            const truth is_flat = both_of(going, both_of(far > most, nearby == 0.0)); /* w crosses a flat curve at once */
            if (in_any(is_flat)) {
                w = either(is_flat, w + signed_like(smaller(most, room), towards), w);
                force = either(is_flat, valve_force(p, w), force);
                moves &= is_false(is_flat);
                if (!in_any(moves)) {
                    continue;
                }
            }
            left = either(far > most, smaller(left, time_for(most, size_of(gap), far, left, nearby)), left);
        }
        const real end = either(time + left >= piece->step, piece->velocity_end, velocity_at(piece, time + left));
        const real tau = chord_time_constant(p, w, force, nearby, v, end, left, room, moves);
        Part part = {v, end, left, room};
        const real change = change_over(p, w, force, tau, &part, moves);
        real after = w + signed_like(smaller(size_of(change), room), change);
        after = smaller(larger(after, smaller(smaller(w, v), end)), larger(larger(w, v), end));
        real reached = valve_force(p, after);
        const real most_change = p->series_stiffness * part.left * far + FORCE_ROUNDING * size_of(force); /* |dF/dt| <= k far */
        const truth falls = both_of(moves, size_of(reached - force) > most_change); /* a little here, and w crosses the dip at once */
        if (in_any(falls)) {
            const real limit = force + signed_like(most_change, reached - force);
            after = either(falls, velocity_under(p, limit, w, force, falls), after);
            reached = either(falls, valve_force(p, after), reached);
        }
        w = either(moves, after, w);
        force = either(moves, reached, force);
        time = either(moves, either(time + part.left >= piece->step, piece->step, time + part.left), time);
    }
    return force;
}

#ifndef EIGHTPOST_LANES

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
    return advance_force(p, lagged, piece, 1);
}

/* dF/dt = k (v - w) with f(w) = F, and so dw/dF = 1 / f'(w). */
Rate law_rate(const Parameters *p, double lagged, double velocity, double static_force)
{
    const double w = velocity_under(p, lagged, velocity, static_force, 1), k = p->series_stiffness;
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

#endif
