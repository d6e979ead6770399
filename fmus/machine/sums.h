/* Sums over the steps of a run, and the statistics of its recorded rows. */
#ifndef EIGHTPOST_SUMS_H
#define EIGHTPOST_SUMS_H

#include "march.h"

/* ---- Bonds ------------------------------------------------------------------------------------------------------------------ */

/* Work through the bonds by Simpson's rule. The defect of a velocity is its change in the last sweep, and that of a force how far its
 * middle is from the parabola through the start of the last step and both ends: the quadratics cannot follow what is beyond that. */
static inline WITHIN void add_bonds(March *m, const real *missed)
{
    Totals *t = &m->totals;
    const double sixth = m->run->step / 6.0;
    for (int c = 0; c < CORNERS; c++) {
        const real f0 = m->force[AT_START][c], f1 = m->force[AT_MIDDLE][c], f2 = m->force[AT_END][c];
        const real v0 = m->at[AT_START][c].velocity, v1 = m->at[AT_MIDDLE][c].velocity, v2 = m->at[AT_END][c].velocity;
        const real apart = f1 - (0.75 * f0 + 0.375 * f2 - 0.125 * m->before[c]), work = sixth * (f0 * v0 + 4.0 * f1 * v1 + f2 * v2);
        t->transferred[c] += size_of_number(work);
        t->residual[c] += sixth * f2 * missed[c];
        t->defect[c] += missed[c] * missed[c];
        t->defect[CORNERS + c] += apart * apart;
        t->total[c] += v2;
        t->total[CORNERS + c] += f2;
        t->squares[c] += v2 * v2;
        t->squares[CORNERS + c] += f2 * f2;
    }
}

/* ---- Recorded rows ------------------------------------------------------------------------------------------------------------ */

static void read_outputs(March *m)
{
    const Run *run = m->run;
    for (int k = 0; k < run->output_count; k++) {
        const double *row = run->output_rows + k * STATES, *direct = run->direct + k * CORNERS;
        real value = uniform(run->outputs[m->record * run->output_count + k]);
        for (int c = 0; c < CORNERS; c++) {
            value += direct[c] * m->force[AT_START][c];
        }
        m->output[k] = value + row_times(row, m->states);
    }
}

static void see_channels(March *m)
{
    PortSignals signals[CORNERS];
    int known[CORNERS] = {0};
    for (int k = 0; k < m->run->channel_count; k++) {
        const Channel *channel = &m->run->channels[k];
        const int c = channel->corner;
        if (c >= 0 && !known[c]) {
            signals[c] = signals_at(&m->ports[c], &m->at[AT_START][c], &m->cubics[AT_START][c], m->travel[c]);
            known[c] = 1;
        }
        m->seen[k] = c < 0 ? m->output[channel->number] : ((const real *)&signals[c])[channel->number];
    }
}

static void watch(March *m)
{
    const real one = uniform(1.0), none = uniform(0.0);
    for (int c = 0; c < CORNERS; c++) {
        m->totals.beyond[c] += either(is_beyond(&m->ports[c], m->at[AT_START][c].velocity), one, none);
    }
    for (int w = 0; w < m->run->limit_count; w++) {
        const Limit *limit = &m->run->limits[w];
        m->totals.watched[w] += either(limit->sign * m->output[limit->output] > limit->limit, one, none);
    }
}

static real with_term(const Quantity *q, real value, real next)
{
    return q->is_product ? value * next : value + next;
}

static real value_of(const March *m, const Quantity *q)
{
    const int *terms = m->run->terms + q->first;
    const double *weights = m->run->weights + q->first;
    real value = weights[0] * m->seen[terms[0]];
    for (int k = 1; k < q->count; k++) {
        value = with_term(q, value, weights[k] * m->seen[terms[k]]);
    }
    return value;
}

static void add_row(real *to, const Quantity *q, real value, int is_first)
{
    if (is_first) {
        to[SHIFT] = to[LEAST] = to[LARGEST_VALUE] = to[FIRST_VALUE] = value;
        to[SUM] = to[SQUARES] = to[INSIDE] = uniform(0.0);
    }
    const real apart = value - to[SHIFT];
    to[SUM] += apart;
    to[SQUARES] += apart * apart;
    if (q->has_limits) {
        to[LEAST] = either(value < to[LEAST], value, to[LEAST]);
        to[LARGEST_VALUE] = either(value > to[LARGEST_VALUE], value, to[LARGEST_VALUE]);
        to[INSIDE] += either((value >= q->low) & (value < q->high), uniform(1.0), uniform(0.0));
    }
    to[LAST_VALUE] = value;
}

static void record(March *m, const Sums *sums)
{
    const Run *run = m->run;
    real *values = (real *)(void *)sums->values + m->record * run->series_count;
    read_outputs(m);
    see_channels(m);
    for (int k = 0; k < run->series_count; k++) {
        values[k] = m->seen[run->series[k]];
    }
    for (int k = 0; k < run->quantity_count; k++) {
        const Quantity *q = &run->quantities[k];
        if (m->record >= q->begin && m->record < q->end) {
            add_row((real *)(void *)sums->statistics + k * STATISTICS, q, value_of(m, q), m->record == q->begin);
        }
    }
    if (m->record >= run->settling) {
        watch(m);
    }
    m->record++;
}

static void report(const March *m, const Sums *sums)
{
    const Totals *t = &m->totals;
    memcpy(sums->transferred, t->transferred, sizeof t->transferred);
    memcpy(sums->residual, t->residual, sizeof t->residual);
    memcpy(sums->defect, t->defect, sizeof t->defect);
    memcpy(sums->total, t->total, sizeof t->total);
    memcpy(sums->squares, t->squares, sizeof t->squares);
    memcpy(sums->beyond, t->beyond, sizeof t->beyond);
    memcpy(sums->watched, t->watched, (size_t)m->run->limit_count * sizeof(real));
}

/* Sums the statistics of a quantity of series, the rows of which are in `columns`. */
EXPORTED void sum_series(const Quantity *q, const real *const *columns, const double *weights, double *statistics)
{
    for (int row = q->begin; row < q->end; row++) {
        real value = weights[0] * columns[0][row];
        for (int k = 1; k < q->count; k++) {
            value = with_term(q, value, weights[k] * columns[k][row]);
        }
        add_row((real *)(void *)statistics, q, value, row == q->begin);
    }
}

#endif
