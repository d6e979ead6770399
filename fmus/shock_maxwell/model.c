/* Maxwell: the static curve and a stiffness in series, dF/dt = k (v - w), F = f(w). The same operations in the same order
 * as eightpost/shock/maxwell.py, which the fit uses. Velocities are the damper's. */
#include "curve.h"
#include "lag.h"
#include "shock.h"

/* Most that w moves [m/s] while the curve is taken as straight; the shortest chord, and the first of the search [m/s]; where
 * nothing is left of a lag's beginning; where a force is found; most parts of a piece, tries of the search, looks at a side of
 * the curve: maxwell.py, law.py, curve.py. */
static const double CHORD = 0.01, SHORTEST = 1e-9, FIRST = 1e-3, SETTLED = 1000.0, FOUND = 4e-16;
enum { MOST_PARTS = 1000, MOST_TRIES = 100, LOOKS = 256 };

static double signed_like(double size, double sign)
{
    return sign < 0.0 ? -size : size;
}

static double larger(double a, double b)
{
    return b > a ? b : a;
}

/* w with f(w) = force, beginning at a guess with its force: secants inside a bracket. */
static double velocity_under(const Parameters *p, double force, double guess, double guess_force)
{
    double before = guess, before_miss = guess_force - force, low = guess, high = guess;
    int bounded = 0;
    if (before_miss == 0.0) {
        return guess;
    }
    const double slope = (valve_force(p, guess + FIRST) - guess_force) / FIRST;
    double here = guess + (slope > 0.0 ? -before_miss / slope : signed_like(CHORD, -before_miss));
    for (int tries = 0; tries < MOST_TRIES; tries++) {
        const double miss = valve_force(p, here) - force;
        if (size_of(miss) <= FOUND * size_of(force) || miss == before_miss || here == before) {
            return here;
        }
        if ((miss > 0.0) != (before_miss > 0.0) && !bounded) {
            low = here < before ? here : before;
            high = larger(here, before);
            bounded = 1;
        } else if (bounded && miss > 0.0) {
            high = here;
        } else if (bounded) {
            low = here;
        }
        double there = here - miss * (here - before) / (miss - before_miss);
        if (bounded && !(low < there && there < high)) {
            there = 0.5 * (low + high);
        } else if (!bounded && !((there - here) * miss < 0.0)) {
            there = here + signed_like(2.0 * size_of(here - before), -miss);
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

/* The slope of the chord from w, where F = force, over a change of w, over k. */
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

/* First with a tau from nearby, then twice with that of the chord to where the last one led. */
static double moved(const Parameters *p, double w, double force, double tau, double v, double end, double h)
{
    const double first = followed(w, v, end, tau, h);
    if (first == w) {
        return w;
    }
    const double second = followed(w, v, end, time_constant_over(p, w, force, first - w), h);
    return second == w ? w : followed(w, v, end, time_constant_over(p, w, force, second - w), h);
}

static double advance_force(const Parameters *p, double lagged, const Piece *piece)
{
    double w = velocity_under(p, lagged, piece->velocity_start, piece->static_start), force = lagged, time = 0.0;
    const double most = larger(CHORD, 2.0 * reach(w, piece->velocity_start, piece->velocity_end) / MOST_PARTS);
    for (int part = 0; part < MOST_PARTS; part++) {
        const double v = velocity_at(piece, time), gap = v - w, last = piece->velocity_end - w;
        const double far = reach(w, v, piece->velocity_end), towards = size_of(gap) >= size_of(last) ? gap : last;
        double left = piece->step - time;
        if (far == 0.0 || left <= 0.0) {
            return force;
        }
        const double tau = time_constant_over(p, w, force, signed_like(far < most ? far : most, towards));
        if (far > most && part < MOST_PARTS - 1) {
            if (tau == 0.0) { /* flat: w is across it at once */
                w += signed_like(most, towards);
                force = valve_force(p, w);
                continue;
            }
            left = tau * most / far < left ? tau * most / far : left; /* |dw/dt| is at most far / tau */
        }
        const int is_last = time + left >= piece->step;
        w = moved(p, w, force, tau, v, is_last ? piece->velocity_end : velocity_at(piece, time + left), left);
        force = valve_force(p, w);
        time = is_last ? piece->step : time + left;
    }
    return force;
}

/* ---- What shock.h asks of a law ---------------------------------------------------------------------------------------- */

/* alpha = 1: all of the valves' force goes through the spring. */
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

/* Looked at on equal steps of a side: StaticCurve.falls_at. */
static int rises(const Parameters *p, double side, double speed)
{
    double before = 0.0;
    for (int k = 1; k <= LOOKS; k++) {
        const double force = curve_force(p, side * speed * ((double)k / (double)LOOKS));
        if (!(side * (force - before) > 0.0)) {
            return 0;
        }
        before = force;
    }
    return 1;
}

/* w follows from F only where the curve rises all over. */
const char *law_refuses(const Parameters *p)
{
    if (p->compression_scale <= 0.0 || p->rebound_scale <= 0.0) {
        return "compression_scale and rebound_scale must be positive under a Maxwell law: its curve must rise all over";
    }
    if (!rises(p, 1.0, p->curve_compression_speed)) {
        return "the curve does not rise all over in compression, and a Maxwell law needs one that does";
    }
    if (!rises(p, -1.0, p->curve_rebound_speed)) {
        return "the curve does not rise all over in rebound, and a Maxwell law needs one that does";
    }
    return p->curve_compression_slope > 0.0 && p->curve_rebound_slope > 0.0
               ? NULL
               : "curve.compression_slope and curve.rebound_slope must be positive under a Maxwell law";
}
