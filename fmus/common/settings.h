/* Effect of the adjusters and of the temperature on the curve and the law, bit for bit as in eightpost/shock/settings.py (except for
 * the last digits of an exponential). An FMU without settings contains only the last lines of this file. */
#ifndef EIGHTPOST_SETTINGS_H
#define EIGHTPOST_SETTINGS_H

#include "component.h"
#include "curve.h"
#include "elementary.h"

#ifdef HAS_SETTINGS
static double not_negative(double value)
{
    return value > 0.0 ? value : 0.0;
}

/* A part of an assembly has a file of its own. */
#ifndef SETTINGS_DATA
#define SETTINGS_DATA "settings_data.h"
#endif
#include SETTINGS_DATA

/* Parameters at a setting, the values that they were computed from, and where the setting is among the measured ones. */
typedef struct {
    double setting[AXES];
    Parameters given, now;
    double beyond, untested;
} AtSetting;

/* ---- Weights of the measured settings of an axis in the interpolant ---------------------------------------------------- */

/* The slope of the chord from node j to the next one, times a factor. */
static void add_chord(double *weights, const double *nodes, int j, double factor)
{
    const double share = factor / (nodes[j + 1] - nodes[j]);
    weights[j] -= share;
    weights[j + 1] += share;
}

/* The slope at an inner node of the parabola through it and its neighbours, times a factor. */
static void add_inner_tangent(double *weights, const double *nodes, int j, double factor)
{
    const double before = nodes[j] - nodes[j - 1], after = nodes[j + 1] - nodes[j];
    add_chord(weights, nodes, j - 1, factor * (after / (before + after)));
    add_chord(weights, nodes, j, factor * (before / (before + after)));
}

static void add_tangent(double *weights, const double *nodes, int count, int j, double factor)
{
    if (count == 2) {
        add_chord(weights, nodes, 0, factor);
    } else if (j == 0) {
        add_chord(weights, nodes, 0, 2.0 * factor);
        add_inner_tangent(weights, nodes, 1, -factor);
    } else if (j == count - 1) {
        add_chord(weights, nodes, j - 1, 2.0 * factor);
        add_inner_tangent(weights, nodes, j - 1, -factor);
    } else {
        add_inner_tangent(weights, nodes, j, factor);
    }
}

/* The number of the interval between nodes that contains a value, or of the nearest one. */
static int interval_of(const double *nodes, int count, double value)
{
    int j = 0;
    while (j < count - 2 && nodes[j + 1] <= value) {
        j++;
    }
    return j;
}

static void weigh_nodes(double *weights, const double *nodes, int count, double value)
{
    for (int j = 0; j < MOST_NODES; j++) {
        weights[j] = 0.0;
    }
    if (value <= nodes[0]) {
        weights[0] = 1.0;
        add_tangent(weights, nodes, count, 0, value - nodes[0]);
    } else if (value >= nodes[count - 1]) {
        weights[count - 1] = 1.0;
        add_tangent(weights, nodes, count, count - 1, value - nodes[count - 1]);
    } else {
        const int j = interval_of(nodes, count, value);
        const double width = nodes[j + 1] - nodes[j], w = (value - nodes[j]) / width;
        weights[j] += (1.0 + 2.0 * w) * (1.0 - w) * (1.0 - w);
        weights[j + 1] += w * w * (3.0 - 2.0 * w);
        add_tangent(weights, nodes, count, j, width * w * (1.0 - w) * (1.0 - w));
        add_tangent(weights, nodes, count, j + 1, width * w * w * (w - 1.0));
    }
}

/* ---- Deviations from the reference, and the parameters with them -------------------------------------------------------- */

/* The nodes of a row of a term's table; the last axis varies fastest. Returns the product of their weights. */
static double share_of_row(const TermTable *term, int row, double (*weights)[MOST_NODES])
{
    int place[AXES], rest = row;
    for (int k = term->axes - 1; k >= 0; k--) {
        const int count = node_counts[term->axis[k]];
        place[k] = rest % count;
        rest /= count;
    }
    double share = 1.0;
    for (int k = 0; k < term->axes; k++) {
        share *= weights[term->axis[k]][place[k]];
    }
    return share;
}

static void sum_deviations(double *total, const double *setting)
{
    double weights[AXES][MOST_NODES];
    for (int k = 0; k < AXES; k++) {
        weigh_nodes(weights[k], axis_nodes[k], node_counts[k], setting[k]);
    }
    for (int k = 0; k < DEVIATIONS; k++) {
        total[k] = 0.0;
    }
    for (int t = 0; t < TERMS; t++) {
        for (int row = 0; row < terms[t].rows; row++) {
            const double share = share_of_row(&terms[t], row, weights), *values = deviations[terms[t].first + row];
            for (int k = 0; k < DEVIATIONS && share != 0.0; k++) {
                total[k] += share * values[k];
            }
        }
    }
}

/* Changes the slopes at the knots, and the forces by the trapezoids of these changes, from zero velocity outwards. */
static void change_slopes(Parameters *now, const double *by)
{
    const double *v = now->curve_knot_velocity;
    double change[KNOTS], total = 0.0;
    for (int k = 0; k < KNOTS; k++) {
        const double before = now->curve_knot_slope[k];
        now->curve_knot_slope[k] = not_negative(before + by[k]);
        change[k] = now->curve_knot_slope[k] - before;
    }
    for (int k = KNOTS / 2 + 1; k < KNOTS; k++) {
        total += 0.5 * (change[k - 1] + change[k]) * (v[k] - v[k - 1]);
        now->curve_knot_force[k] += total;
    }
    total = 0.0;
    for (int k = KNOTS / 2 - 1; k >= 0; k--) {
        total -= 0.5 * (change[k] + change[k + 1]) * (v[k + 1] - v[k]);
        now->curve_knot_force[k] += total;
    }
    now->curve_compression_slope = not_negative(now->curve_compression_slope + by[KNOTS - 1]);
    now->curve_rebound_slope = not_negative(now->curve_rebound_slope + by[0]);
}

/* ---- Where a setting is among the measured ones -------------------------------------------------------------------------- */

static double intervals_beyond(int axis, double value)
{
    const double *nodes = axis_nodes[axis];
    const int count = node_counts[axis], j = value < nodes[0] ? 0 : count - 2;
    const double below = nodes[0] - value, above = value - nodes[count - 1], distance = below > above ? below : above;
    return distance > 0.0 ? distance / (nodes[j + 1] - nodes[j]) : 0.0;
}

/* The measured settings next to a value, twice the same one at a node and beyond the nodes. */
static void find_neighbours(double *near, int axis, double value)
{
    const double *nodes = axis_nodes[axis];
    const int count = node_counts[axis], j = interval_of(nodes, count, value);
    near[0] = value >= nodes[j + 1] ? nodes[j + 1] : nodes[j];
    near[1] = value <= nodes[j] ? nodes[j] : value >= nodes[j + 1] ? nodes[j + 1] : value == nodes[j] ? nodes[j] : nodes[j + 1];
}

static int was_tested(const double *combination)
{
    for (int row = 0; row < TESTED; row++) {
        int same = 1;
        for (int k = 0; k < AXES; k++) {
            same &= tested[row][k] == combination[k];
        }
        if (same) {
            return 1;
        }
    }
    return 0;
}

static int is_untested(const double *setting)
{
    double near[AXES][2], combination[AXES];
    for (int k = 0; k < AXES; k++) {
        find_neighbours(near[k], k, setting[k]);
    }
    for (unsigned corner = 0; corner < 1U << AXES; corner++) {
        for (int k = 0; k < AXES; k++) {
            combination[k] = near[k][corner >> k & 1U];
        }
        if (!was_tested(combination)) {
            return 1;
        }
    }
    return 0;
}

/* ---- The parameters in use ---------------------------------------------------------------------------------------------- */

static Parameters parameters_at(const Parameters *given, const double *setting)
{
    double by[DEVIATIONS];
    Parameters now = *given;
    sum_deviations(by, setting);
    change_slopes(&now, by);
    change_own(&now, given, by + KNOTS);
    now.gas_preload += by[DEVIATIONS - 1];
    return now;
}

static int is_current(const AtSetting *at, const Values *values, const double *setting)
{
    const double *given = (const double *)&at->given, *wanted = (const double *)&values->named.parameters;
    int same = 1;
    for (int k = 0; k < AXES; k++) {
        same &= at->setting[k] == setting[k];
    }
    for (size_t k = 0; k < sizeof(Parameters) / sizeof(double); k++) {
        same &= given[k] == wanted[k];
    }
    return same;
}

/* The parameters at the present setting; they are computed when it, or a parameter, has changed. */
static AtSetting *at_setting(const Memory *memory, void *work)
{
    AtSetting *at = (AtSetting *)work;
    double setting[AXES];
    read_setting(&memory->values, setting);
    if (!is_current(at, &memory->values, setting)) {
        at->given = memory->values.named.parameters;
        at->now = parameters_at(&at->given, setting);
        at->beyond = 0.0;
        for (int k = 0; k < AXES; k++) {
            const double beyond = intervals_beyond(k, setting[k]);
            at->setting[k] = setting[k];
            at->beyond = beyond > at->beyond ? beyond : at->beyond;
        }
        at->untested = is_untested(setting) ? 1.0 : 0.0;
    }
    return at;
}

static const Parameters *parameters_in_use(const Memory *memory, void *work)
{
    return &at_setting(memory, work)->now;
}

static void report_setting(Memory *memory, void *work)
{
    const AtSetting *at = at_setting(memory, work);
    memory->values.named.signals.beyond_settings = at->beyond;
    memory->values.named.signals.untested_settings = at->untested;
}

static size_t settings_size(void)
{
    return sizeof(AtSetting);
}

#else

enum { TEMPERATURE_INPUT = -1 };

static inline const Parameters *parameters_in_use(const Memory *memory, void *work)
{
    (void)work;
    return &memory->values.named.parameters;
}

static inline void report_setting(Memory *memory, void *work)
{
    (void)memory;
    (void)work;
}

static inline size_t settings_size(void)
{
    return 0;
}

#endif
#endif
