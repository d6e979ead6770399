/* A run of several setups at once. The car is linear and is advanced exactly; what the drive does to it is known. A step's port forces
 * are quadratics through their values at its start, middle and end, where they follow the velocities that they cause: a few sweeps
 * around the dampers of the car find both. */
#include "march.h"
#include "sums.h"

#ifndef SWEEPS
#define SWEEPS 2
#endif

/* Size of a signal at which a setup has diverged. */
static const number LARGEST = 1e15;

/* ---- A step ------------------------------------------------------------------------------------------------------------------- */

/* The states at the end of the next step without its forces. */
static inline WITHIN void predict(March *m)
{
    const Car *car = m->run->car;
    real *states = m->states;
    real old[STATES + FORCES]; /* a copy, which a compiler keeps in registers */
    memcpy(old, m->states, sizeof old);
    UNROLLED
    for (int k = 0; k < PAIRS; k++) {
        const real x = old[2 * k], y = old[2 * k + 1];
        const real first = car->turn[k][0] * x - car->turn[k][1] * y, second = car->turn[k][1] * x + car->turn[k][0] * y;
        states[2 * k] = with_row(first, car->load[2 * k], old + STATES, FORCES);
        states[2 * k + 1] = with_row(second, car->load[2 * k + 1], old + STATES, FORCES);
    }
}

/* A step of a port: the points in its middle and at its end, with their cubics and forces. */
typedef struct {
    Point at[NODES];
    Cubics cubics[NODES];
    real force[NODES];
} Step;

/* The velocity of a port in the middle of the step by that at its end: on the cubic through the ends of the last steps. */
static inline WITHIN real between(const March *m, int c, real velocity)
{
    return 0.9375 * m->at[c].velocity + (0.3125 * velocity + (0.0625 * m->earlier[1][c] - 0.3125 * m->earlier[0][c]));
}

/* The places of the cubics of all ports in the middle and at the end of the step, by the velocities at its end. */
static inline WITHIN void find_places(const March *m, Kinds kinds, const real *velocity, Places *found)
{
    UNROLLED
    for (int c = 0; c < CORNERS; c++) {
        const Port *port = &m->ports[c];
        find_both(port, by_ratio(port, kinds, between(m, c, velocity[c])), by_ratio(port, kinds, velocity[c]), &found[c]);
    }
}

/* The forces in the middle of the step and at its end, and what is beyond the dampers. */
static inline WITHIN void find_forces(const March *m, Kinds kinds, int c, real travel, Step *s, real *beyond)
{
    const real velocity = s->at[END_OF_STEP].velocity, change = (number)m->run->step * (m->at[c].velocity - velocity);
    const real ways[NODES] = {0.5 * (m->travel[c] + travel) + 0.125 * change, travel};
    UNROLLED
    for (int node = 0; node < NODES; node++) {
        s->force[node] = force_at(&m->ports[c], kinds, &s->at[node], &s->cubics[node], ways[node]);
        beyond[node * CORNERS + c] = s->force[node] - m->run->car->damping[c] * s->at[node].velocity;
    }
}

/* The forces of a step, which are found, and the states of the port become those of the next step's start: kept until the velocities
 * are found, they would take twice the stores, which limit a step. `work` is that of the start and the middle in Simpson's rule. */
static inline WITHIN void keep_forces(March *m, Kinds kinds, int c, const Step *s, int is_recorded, real *work)
{
    const Point *end = &s->at[END_OF_STEP];
    Point *at = &m->at[c];
    *work = m->force[c] * at->velocity + 4.0 * (s->force[MIDDLE_OF_STEP] * s->at[MIDDLE_OF_STEP].velocity);
    if (is_recorded) {
        add_force(m, c, s->force);
    }
    m->before[c] = m->force[c];
    m->force[c] = s->force[END_OF_STEP];
    at->static_force = end->static_force;
    at->lagged = end->lagged;
    if (kinds.friction) {
        at->bend = end->bend;
    }
    if (kinds.hysteresis) {
        at->travel = end->travel;
        m->cubics[c] = s->cubics[END_OF_STEP];
    }
}

/* Evaluates the ports at velocities and travels at the end of the step, whose cubics are `found` unless they are known. */
static inline WITHIN void evaluate(const March *m, Kinds kinds, int c, const real *velocity, const real *travel, const Places *found,
                                   Step *s, real *beyond)
{
    const int known = found == NULL;
    if (!known && kinds.knots) {
        gather_cubics(&m->ports[c], kinds, &found[c], s->cubics);
    }
    follow(&m->ports[c], kinds, &m->at[c], between(m, c, velocity[c]), known, &s->cubics[MIDDLE_OF_STEP], &s->at[MIDDLE_OF_STEP]);
    follow(&m->ports[c], kinds, &s->at[MIDDLE_OF_STEP], velocity[c], known, &s->cubics[END_OF_STEP], &s->at[END_OF_STEP]);
    find_forces(m, kinds, c, travel[c], s, beyond);
}

/* Advances the car and its ports by a step: finds its forces with the velocities that they cause. */
static inline WITHIN void take_step(March *m, Kinds kinds, int64_t step, int is_recorded)
{
    const Car *car = m->run->car;
    const number *road = m->run->velocities + (step + 1) * CORNERS, *travels = m->run->travels + (step + 1) * CORNERS;
    real free[CORNERS], free_travel[CORNERS], velocity[CORNERS], travel[CORNERS], missed[CORNERS], work[CORNERS];
    real *states = m->states, beyond[FORCES];
    Step steps[CORNERS];
    Places found[CORNERS];
    predict(m);
    UNROLLED
    for (int c = 0; c < CORNERS; c++) {
        free[c] = with_row(uniform(road[c]), car->velocity[c], states, STATES);
        velocity[c] = 3.0 * (m->at[c].velocity - m->earlier[0][c]) + m->earlier[1][c];
        travel[c] = uniform(0.0);
        if (kinds.travel) {
            travel[c] = free_travel[c] = with_row(uniform(travels[c]), car->travel[c], states, STATES);
        }
    }
    if (kinds.knots) {
        find_places(m, kinds, velocity, found);
    }
    UNROLLED
    for (int n = 0; n < SWEEPS; n++) {
        UNROLLED
        for (int c = 0; c < CORNERS; c++) {
            evaluate(m, kinds, c, velocity, travel, n > 0 ? NULL : found, &steps[c], beyond);
            if (n == SWEEPS - 1) {
                keep_forces(m, kinds, c, &steps[c], is_recorded, &work[c]);
            }
        }
        UNROLLED
        for (int c = 0; c < CORNERS; c++) {
            const real then = with_row(free[c], car->moved[c], beyond, FORCES);
            missed[c] = then - velocity[c];
            velocity[c] = then;
            travel[c] = kinds.travel ? with_row(free_travel[c], car->travelled[c], beyond, FORCES) : travel[c];
        }
    }
    memcpy(m->states + STATES, beyond, sizeof beyond);
    if (kinds.travel) {
        memcpy(m->travel, travel, sizeof travel);
    }
    UNROLLED
    for (int c = 0; c < CORNERS; c++) {
        add_work(m, c, work[c], velocity[c], missed[c]);
        if (is_recorded) {
            add_velocity(m, c, velocity[c], missed[c]);
        }
        m->earlier[1][c] = m->earlier[0][c];
        m->earlier[0][c] = m->at[c].velocity;
        m->at[c].velocity = velocity[c];
    }
}

/* The most frequent kinds of runs have code of their own. */
static const Kinds PLAIN = {.knots = 1}, WITH_RATIOS = {.knots = 1, .ratios = 1};

static APART void take_plain_step(March *m, int64_t step, int is_recorded)
{
    take_step(m, PLAIN, step, is_recorded);
}

static APART void take_step_with_ratios(March *m, int64_t step, int is_recorded)
{
    take_step(m, WITH_RATIOS, step, is_recorded);
}

static APART void take_any_step(March *m, int64_t step, int is_recorded)
{
    take_step(m, m->kinds, step, is_recorded);
}

/* ---- The start ---------------------------------------------------------------------------------------------------------------- */

enum { MOST_TURNS_TO_REST = 60 };
static const number AT_REST = IS_DOUBLE ? 1e-12 : 1e-7; /* its change, relative to 1 m */

/* The forces at the start, and the states at rest under them. */
static void rest(March *m)
{
    const Car *car = m->run->car;
    real *forces = m->states + STATES;
    for (int c = 0; c < CORNERS; c++) {
        m->force[c] = m->before[c] = force_at(&m->ports[c], m->kinds, &m->at[c], &m->cubics[c], m->travel[c]);
        forces[c] = forces[CORNERS + c] = m->force[c] - car->damping[c] * m->at[c].velocity;
    }
    for (int i = 0; i < STATES; i++) {
        m->states[i] = with_row(uniform(0.0), car->rest[i], forces, CORNERS);
    }
}

/* Finds the travel under constant forces; returns in which setups it is found. */
static truth start(March *m)
{
    const Run *run = m->run;
    truth found = {0};
    for (int c = 0; c < CORNERS; c++) {
        start_point(&m->ports[c], m->kinds, uniform(run->velocities[c]), &m->cubics[c], &m->at[c]);
        m->earlier[0][c] = m->earlier[1][c] = m->at[c].velocity;
        m->travel[c] = uniform(run->travels[c]);
    }
    rest(m);
    for (int n = 0; n < MOST_TURNS_TO_REST && !in_every(found); n++) {
        real worst = uniform(0.0);
        for (int c = 0; c < CORNERS; c++) {
            const real travel = with_row(uniform(run->travels[c]), run->car->sunk[c], m->states + STATES, CORNERS);
            const real change = size_of(travel - m->travel[c]) / (1.0 + size_of(travel));
            worst = either(change > worst, change, worst);
            m->travel[c] = either(found, m->travel[c], travel);
        }
        found |= worst <= AT_REST;
        rest(m);
    }
    return found;
}

/* ---- The run ------------------------------------------------------------------------------------------------------------------ */

/* Puts zeros in place of the numbers of setups that are no longer sensible. */
static void retire(March *m, truth ended, int64_t step, int64_t *at)
{
    real *numbers = (real *)(void *)m->states;
    const size_t count = (offsetof(March, alive) - offsetof(March, states)) / sizeof(real);
    for (size_t k = 0; k < count; k++) {
        numbers[k] = either(ended, uniform(0.0), numbers[k]);
    }
    for (int k = 0; k < SETUPS; k++) {
        if (ended[k] && m->alive[k]) {
            at[k] = step;
        }
    }
    m->alive &= ~ended;
}

static truth are_sensible(const March *m)
{
    real sum = uniform(0.0);
    for (int c = 0; c < CORNERS; c++) {
        const real v = m->at[c].velocity, f = m->force[c];
        sum += v * v + f * f;
    }
    return sum < LARGEST * LARGEST;
}

static void march(March *m, const Sums *sums)
{
    const int is_plain = memcmp(&m->kinds, &PLAIN, sizeof PLAIN) == 0;
    const int has_ratios = memcmp(&m->kinds, &WITH_RATIOS, sizeof WITH_RATIOS) == 0;
    void (*take)(March *, int64_t, int) = is_plain ? take_plain_step : has_ratios ? take_step_with_ratios : take_any_step;
    int64_t left = m->run->every;
    for (int64_t k = 0; k < m->run->steps && in_any(m->alive); k++) {
        left--;
        take(m, k, left == 0);
        if (left == 0) {
            const truth sensible = are_sensible(m);
            left = m->run->every;
            if (!in_every(sensible)) {
                retire(m, ~sensible, k, sums->ended);
            }
            record(m, sums, k + 1 == m->run->steps || !in_any(m->alive));
        }
    }
}

/* Numbers for Python. */
EXPORTED int64_t size_of_march(void)
{
    return (int64_t)sizeof(March);
}

EXPORTED int64_t number_of_parameters(void)
{
    return PARAMETERS;
}

EXPORTED int64_t size_of_number(void)
{
    return (int64_t)sizeof(number);
}

EXPORTED int64_t number_of_setups(void)
{
    return SETUPS;
}

/* Runs SETUPS setups. `parameters` (CORNERS, PARAMETERS, SETUPS) and `laws` (CORNERS, SETUPS) are those of the shocks; `space` is for
 * the data of the run, at a multiple of 64. */
EXPORTED void run_machine(const Run *run, const number *parameters, const integer *laws, void *space, const Sums *sums)
{
    March *m = (March *)space;
    memset(m, 0, offsetof(March, seen));
    m->run = run;
    m->alive = ~(truth){0};
    for (int c = 0; c < CORNERS; c++) {
        Port *port = &m->ports[c];
        memcpy(&port->parameters, parameters + (size_t)c * PARAMETERS * SETUPS, PARAMETERS * sizeof(real));
        memcpy(&port->law, laws + (size_t)c * SETUPS, sizeof port->law);
        prepare_port(port, &run->car->friction[c], run->step, &m->kinds);
    }
    for (int k = 0; k < SETUPS; k++) {
        sums->ended[k] = -1;
    }
    const truth found = start(m);
    retire(m, ~found, 0, sums->ended);
    record(m, sums, 0);
    march(m, sums);
    report(m, sums);
}
