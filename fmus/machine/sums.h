/* Sums over the steps of a run, and the statistics of its recorded rows. */
#ifndef EIGHTPOST_SUMS_H
#define EIGHTPOST_SUMS_H

#include "march.h"

/* ---- Bonds ------------------------------------------------------------------------------------------------------------------ */

/* Work through a bond by Simpson's rule, of which `work` is the part of the start and the middle; `missed` is the change of the velocity
 * in the last sweep. */
static inline WITHIN void add_work(March *m, int c, real work, real velocity, real missed)
{
    const number sixth = (number)(m->run->step * (1.0 / 6.0));
    const real force = m->force[c];
    m->totals.transferred[c] += size_of(sixth * (work + force * velocity));
    m->totals.residual[c] += sixth * force * missed;
}

static inline WITHIN void add_to(Totals *t, int place, real value, real defect)
{
    t->defect[place] += defect * defect;
    t->total[place] += value;
    t->squares[place] += value * value;
}

/* The defect of a velocity is its change in the last sweep. */
static inline WITHIN void add_velocity(March *m, int c, real velocity, real missed)
{
    add_to(&m->totals, c, velocity, missed);
}

/* That of a force is how far its middle is from the parabola through the start of the last step and both ends: the quadratics cannot
 * follow what is beyond that. */
static inline WITHIN void add_force(March *m, int c, const real *found)
{
    const real end = found[END_OF_STEP];
    add_to(&m->totals, CORNERS + c, end, found[MIDDLE_OF_STEP] - (0.75 * m->force[c] + 0.375 * end - 0.125 * m->before[c]));
}

/* ---- Recorded rows ------------------------------------------------------------------------------------------------------------ */

/* The recorded channels of the last step. */
static void see_channels(March *m, real *seen)
{
    const Run *run = m->run;
    const number *by_drive = run->outputs + m->record * run->output_count;
    real states[STATES + FORCES]; /* a copy, which a compiler keeps in registers */
    memcpy(states, m->states, sizeof states);
    for (int k = 0; k < run->output_count; k++) {
        seen[k] = with_row(uniform(by_drive[k]), run->output_rows + k * (STATES + FORCES), states, STATES + FORCES);
    }
    for (int k = 0; k < run->signal_count; k++) {
        const int c = run->signals[k].corner, number = run->signals[k].number;
        seen[run->output_count + k] = signal_at(&m->ports[c], m->kinds, &m->at[c], &m->cubics[c], m->travel[c], number);
    }
}

static void watch(March *m, const real *seen)
{
    const real one = uniform(1.0), none = uniform(0.0);
    for (int c = 0; c < CORNERS; c++) {
        const Parameters *p = &m->ports[c].parameters;
        m->totals.beyond[c] += either(is_beyond_fit(p, p->motion_ratio * m->at[c].velocity), one, none);
    }
    for (int w = 0; w < m->run->limit_count; w++) {
        const Limit *limit = &m->run->limits[w];
        m->totals.watched[w] += either((number)limit->sign * seen[limit->output] > (number)limit->limit, one, none);
    }
}

/* Statistics of a few rows. */
typedef struct {
    real sum, squares, least, largest, inside;
} Rows;

static inline void add_limits(const Quantity *q, real value, Rows *to)
{
    to->least = either(value < to->least, value, to->least);
    to->largest = either(value > to->largest, value, to->largest);
    to->inside += either((value >= (number)q->low) & (value < (number)q->high), uniform(1.0), uniform(0.0));
}

static inline real value_of(const Quantity *q, const real *const *columns, const number *weights, int64_t at)
{
    real value = weights[0] * columns[0][at];
    for (int k = 1; k < q->count; k++) {
        const real next = weights[k] * columns[k][at];
        value = q->is_product ? value * next : value + next;
    }
    return value;
}

static inline Sum sum_of(real value)
{
    return __builtin_convertvector(value, Sum);
}

/* Adds rows `first` to `last` - 1 of a quantity, which begin in `columns` and are `stride` apart, to its statistics: in single
 * precision they are few, so that their sum is exact enough. */
static void add_rows(const Quantity *q, const real *const *columns, const number *weights, int64_t stride, int first, int last, Sum *to)
{
    const int begin = q->begin > first ? q->begin : first, end = q->end < last ? q->end : last;
    if (begin >= end) {
        return;
    }
    real value = value_of(q, columns, weights, (begin - first) * stride);
    if (begin == q->begin) {
        to[SHIFT] = to[LEAST] = to[LARGEST_VALUE] = to[FIRST_VALUE] = sum_of(value);
        to[SUM] = to[SQUARES] = to[INSIDE] = (Sum){0.0};
    }
    const real shift = __builtin_convertvector(to[SHIFT], real);
    Rows rows = {.least = __builtin_convertvector(to[LEAST], real), .largest = __builtin_convertvector(to[LARGEST_VALUE], real)};
    for (int row = begin; row < end; row++) {
        value = value_of(q, columns, weights, (row - first) * stride);
        const real apart = value - shift;
        rows.sum += apart;
        rows.squares += apart * apart;
        if (q->has_limits) {
            add_limits(q, value, &rows);
        }
    }
    to[SUM] += sum_of(rows.sum);
    to[SQUARES] += sum_of(rows.squares);
    if (q->has_limits) {
        to[LEAST] = sum_of(rows.least);
        to[LARGEST_VALUE] = sum_of(rows.largest);
        to[INSIDE] += sum_of(rows.inside);
    }
    to[LAST_VALUE] = sum_of(value);
}

/* Adds the records since `first` to the statistics of the quantities. */
static void add_quantities(const March *m, int64_t first, const Sums *sums)
{
    const Run *run = m->run;
    const real *columns[MOST_CHANNELS];
    for (int k = 0; k < run->quantity_count; k++) {
        const Quantity *q = &run->quantities[k];
        for (int term = 0; term < q->count; term++) {
            columns[term] = m->seen + run->terms[q->first + term];
        }
        add_rows(q, columns, run->weights + q->first, run->output_count + run->signal_count, (int)first, (int)m->record,
                 (Sum *)(void *)sums->statistics + k * STATISTICS);
    }
}

static void record(March *m, const Sums *sums, int is_last)
{
    const Run *run = m->run;
    const int64_t place = m->record % RECORDS;
    real *seen = m->seen + place * (run->output_count + run->signal_count);
    see_channels(m, seen);
    for (int k = 0; k < run->series_count; k++) {
        ((real *)(void *)sums->values)[m->record * run->series_count + k] = seen[run->series[k]];
    }
    if (m->record >= run->settling) {
        watch(m, seen);
    }
    m->record++;
    if (is_last || place == RECORDS - 1) {
        add_quantities(m, m->record - place - 1, sums);
    }
}

static void report_totals(const real *totals, int64_t count, double *to)
{
    for (int64_t k = 0; k < count; k++) {
        ((Sum *)(void *)to)[k] = sum_of(totals[k]);
    }
}

static void report(const March *m, const Sums *sums)
{
    const Totals *t = &m->totals;
    report_totals(t->transferred, CORNERS, sums->transferred);
    report_totals(t->residual, CORNERS, sums->residual);
    report_totals(t->defect, 2 * CORNERS, sums->defect);
    report_totals(t->total, 2 * CORNERS, sums->total);
    report_totals(t->squares, 2 * CORNERS, sums->squares);
    report_totals(t->beyond, CORNERS, sums->beyond);
    report_totals(t->watched, m->run->limit_count, sums->watched);
}

/* Sums the statistics of a quantity of series, the rows of which are in `columns`. */
EXPORTED void sum_series(const Quantity *q, const real *const *columns, const number *weights, double *statistics)
{
    const real *from[MOST_CHANNELS];
    for (int row = 0; row < q->end; row += RECORDS) {
        for (int k = 0; k < q->count; k++) {
            from[k] = columns[k] + row;
        }
        add_rows(q, from, weights, 1, row, row + RECORDS, (Sum *)(void *)statistics);
    }
}

#endif
