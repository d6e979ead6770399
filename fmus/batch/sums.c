/* Sums over the steps of a batch, as in cosim/engine/march.py, and the statistics of its recorded rows. */
#include "march.h"

/* ---- Bonds and limits ---------------------------------------------------------------------------------------------------- */

/* Adds the squared difference of the assumed and the actual end of a term, and the sums of the term itself; returns twice the mean
 * of its source. */
static real add_term(Totals *t, int k, const Signal *s, const Line *line, double h)
{
    const real came = s->ahead + 0.0, missed = line->end - came;
    t->defect[k] += missed * missed * h;
    t->total[k] += came * h;
    t->squares[k] += came * (came * h);
    return s->now + s->ahead;
}

void add_bonds(March *m, const Step *step)
{
    Totals *t = &m->totals;
    const double h = step->size, half = 0.5 * h;
    t->duration += h;
    for (int c = 0; c < CORNERS; c++) {
        const real moved = add_term(t, c, &m->velocity[c], &m->velocity_line[c], h);
        const real pushed = add_term(t, CORNERS + c, &m->force[c], &m->force_line[c], h);
        const real given = moved * (half * m->force_line[c].mean), taken = pushed * (half * m->velocity_line[c].mean);
        t->residual[c] += given - taken;
        t->transferred[c] += size_of_number(taken);
    }
}

void add_limits(March *m, const Step *step)
{
    Totals *t = &m->totals;
    const real h = uniform(step->size), none = uniform(0.0);
    t->settled += step->size;
    for (int c = 0; c < CORNERS; c++) {
        t->beyond[c] += either(m->ports[c].now.beyond_fit > 0.5, h, none);
    }
    for (int w = 0; w < m->run->limit_count; w++) {
        const Limit *limit = &m->run->limits[w];
        t->watched[w] += either(limit->sign * m->output[limit->output] > limit->limit, h, none);
    }
}

/* ---- Recorded rows ------------------------------------------------------------------------------------------------------------ */

static real value_at(const March *m, const Channel *c)
{
    if (c->corner >= 0) {
        return ((const real *)&m->ports[c->corner].now)[c->number];
    }
    return m->is_needed[c->number] ? m->output[c->number] : vehicle_output(m->run->car, &m->vehicle, c->number);
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

void record(March *m, const Sums *sums)
{
    const Run *run = m->run;
    real *series = (real *)(void *)sums->series + m->row * run->series_count;
    for (int k = 0; k < run->channel_count; k++) {
        const Channel *c = &run->recorded_channels[k];
        m->seen[k] = value_at(m, c);
    }
    for (int k = 0; k < run->series_count; k++) {
        series[k] = m->seen[run->series_channels[k]];
    }
    for (int k = 0; k < run->quantity_count; k++) {
        const Quantity *q = &run->quantities[k];
        if (m->row >= q->begin && m->row < q->end) {
            add_row((real *)(void *)sums->statistics + k * STATISTICS, q, value_of(m, q), m->row == q->begin);
        }
    }
    m->row++;
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

void report(const March *m, const Sums *sums)
{
    const Totals *t = &m->totals;
    memcpy(sums->residual, t->residual, sizeof t->residual);
    memcpy(sums->transferred, t->transferred, sizeof t->transferred);
    memcpy(sums->beyond, t->beyond, sizeof t->beyond);
    memcpy(sums->defect, t->defect, sizeof t->defect);
    memcpy(sums->total, t->total, sizeof t->total);
    memcpy(sums->squares, t->squares, sizeof t->squares);
    memcpy(sums->watched, t->watched, (size_t)m->run->limit_count * sizeof(real));
    *sums->duration = t->duration;
    *sums->settled = t->settled;
    *sums->rows = m->row;
}
