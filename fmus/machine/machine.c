/* A run of several setups at once. The car is linear and is advanced exactly; what the drive does to it is known. A step's port forces
 * are quadratics through their values at its start, middle and end, where they follow the velocities that they cause: a few sweeps
 * around the dampers of the car find both. */
#include "march.h"
#include "sums.h"

#ifndef SWEEPS
#define SWEEPS 2
#endif

/* Size of a signal at which a setup has diverged. */
static const double LARGEST = 1e15;

/* ---- A step ------------------------------------------------------------------------------------------------------------------- */

/* The states at the end of the step without its middle and last forces. */
static inline void predict(const March *m, real *states)
{
    const Car *car = m->run->car;
    for (int k = 0; k < PAIRS; k++) {
        const real x = m->states[2 * k], y = m->states[2 * k + 1];
        states[2 * k] = car->turn[k][0] * x - car->turn[k][1] * y;
        states[2 * k + 1] = car->turn[k][1] * x + car->turn[k][0] * y;
    }
    for (int i = 0; i < STATES; i++) {
        for (int c = 0; c < CORNERS; c++) {
            states[i] += car->load[AT_START][i][c] * m->beyond[AT_START][c];
        }
    }
}

/* Adds the effect of the middle and last forces to the predicted states. */
static inline void finish(March *m, const real *states)
{
    const Car *car = m->run->car;
    real middle[CORNERS], end[CORNERS]; /* copies, which a compiler keeps in registers */
    for (int c = 0; c < CORNERS; c++) {
        middle[c] = m->beyond[AT_MIDDLE][c];
        end[c] = m->beyond[AT_END][c];
    }
    for (int i = 0; i < STATES; i++) {
        real first = states[i], second = uniform(0.0);
        for (int c = 0; c < CORNERS; c++) {
            first += car->load[AT_MIDDLE][i][c] * middle[c];
            second += car->load[AT_END][i][c] * end[c];
        }
        m->states[i] = first + second;
    }
}

/* The force and what is beyond the car's damper. */
static inline WITHIN void find_forces(March *m, int node, const real *travel)
{
    for (int c = 0; c < CORNERS; c++) {
        m->force[node][c] = force_at(&m->ports[c], &m->at[node][c], &m->cubics[node][c], travel[c]);
        m->beyond[node][c] = m->force[node][c] - m->run->car->damping[c] * m->at[node][c].velocity;
    }
}

/* A value at the end of the step by the forces in its middle and at its end. */
static inline real with_forces(const March *m, real free, const double (*by)[CORNERS][CORNERS], int c)
{
    for (int k = 0; k < CORNERS; k++) {
        free += by[AT_MIDDLE][c][k] * m->beyond[AT_MIDDLE][k] + by[AT_END][c][k] * m->beyond[AT_END][k];
    }
    return free;
}

/* The travel in the middle of the step, by those and the velocities at its ends. */
static inline real travel_between(real from, real to, real v0, real v1, double h)
{
    return 0.5 * (from + to) + 0.125 * h * (v0 - v1);
}

/* Evaluates the ports at velocities that a sweep has found. */
static inline WITHIN void evaluate(March *m, const real *velocity, const real *travel, int known)
{
    real middle[CORNERS];
    for (int c = 0; c < CORNERS; c++) {
        Point *at[] = {&m->at[AT_START][c], &m->at[AT_MIDDLE][c], &m->at[AT_END][c]};
        const Port *port = &m->ports[c];
        const real v0 = at[AT_START]->velocity, between = 0.75 * v0 + 0.375 * velocity[c] - 0.125 * m->earlier[0][c];
        if (port->some_knots && !known) {
            const real ratio = port->parameters.motion_ratio;
            find_cubics(port, ratio * between, ratio * velocity[c], &m->cubics[AT_MIDDLE][c].curve, &m->cubics[AT_END][c].curve);
        }
        follow(port, at[AT_START], between, known, &m->cubics[AT_MIDDLE][c], at[AT_MIDDLE]);
        follow(port, at[AT_MIDDLE], velocity[c], known, &m->cubics[AT_END][c], at[AT_END]);
        middle[c] = travel_between(m->travel[c], travel[c], v0, velocity[c], m->run->step);
    }
    find_forces(m, AT_MIDDLE, middle);
    find_forces(m, AT_END, travel);
}

static inline int any_travel(const March *m)
{
    int any = 0;
    for (int c = 0; c < CORNERS; c++) {
        any |= m->ports[c].has_travel;
    }
    return any;
}

/* Advances the car and its ports by a step. */
static void take_step(March *m, int64_t step, int has_travel)
{
    const Car *car = m->run->car;
    const double *road = m->run->velocities + (step + 1) * CORNERS, *travels = m->run->travels + (step + 1) * CORNERS;
    real states[STATES], free[CORNERS], velocity[CORNERS], apart[CORNERS], free_travel[CORNERS] = {{0.0}}, travel[CORNERS] = {{0.0}};
    predict(m, states);
    for (int c = 0; c < CORNERS; c++) {
        free[c] = row_times(car->velocity[c], states) + road[c];
        velocity[c] = 3.0 * (m->at[AT_START][c].velocity - m->earlier[0][c]) + m->earlier[1][c];
        if (has_travel) {
            travel[c] = free_travel[c] = row_times(car->travel[c], states) + travels[c];
        }
    }
    for (int n = 0; n < SWEEPS; n++) {
        evaluate(m, velocity, travel, n > 0);
        for (int c = 0; c < CORNERS; c++) {
            const real found = with_forces(m, free[c], car->moved, c);
            apart[c] = found - velocity[c];
            velocity[c] = found;
            travel[c] = has_travel ? with_forces(m, free_travel[c], car->travelled, c) : travel[c];
        }
    }
    finish(m, states);
    for (int c = 0; c < CORNERS; c++) {
        m->travel[c] = travel[c];
        m->at[AT_END][c].velocity = velocity[c];
    }
    add_bonds(m, apart);
}

/* The end of the step becomes the start of the next one. */
static inline void accept(March *m)
{
    for (int c = 0; c < CORNERS; c++) {
        m->earlier[1][c] = m->earlier[0][c];
        m->earlier[0][c] = m->at[AT_START][c].velocity;
        m->before[c] = m->force[AT_START][c];
        m->at[AT_START][c] = m->at[AT_END][c];
        if (m->ports[c].some_hysteresis) {
            m->cubics[AT_START][c] = m->cubics[AT_END][c];
        }
        m->force[AT_START][c] = m->force[AT_END][c];
        m->beyond[AT_START][c] = m->beyond[AT_END][c];
    }
}

/* ---- The start ---------------------------------------------------------------------------------------------------------------- */

enum { MOST_TURNS_TO_REST = 60 };
static const double AT_REST = 1e-12;

/* The travel under constant forces, with those at the last travel, of setups that are not `found`. Returns the largest change. */
static real settle(March *m, truth found)
{
    const Run *run = m->run;
    real worst = uniform(0.0);
    find_forces(m, AT_START, m->travel);
    for (int i = 0; i < STATES; i++) {
        real state = uniform(0.0);
        for (int c = 0; c < CORNERS && run->at_rest; c++) {
            state += run->car->rest[i][c] * m->beyond[AT_START][c];
        }
        m->states[i] = either(found, m->states[i], state);
    }
    for (int c = 0; c < CORNERS; c++) {
        const real travel = run->travels[c] + row_times(run->car->travel[c], m->states);
        const real change = size_of_number(travel - m->travel[c]) / (1.0 + size_of_number(travel));
        worst = either(change > worst, change, worst);
        m->travel[c] = travel;
    }
    return worst;
}

/* Returns in which setups the car rests under its loads. */
static truth start(March *m)
{
    for (int c = 0; c < CORNERS; c++) {
        start_point(&m->ports[c], uniform(m->run->velocities[c]), &m->cubics[AT_START][c], &m->at[AT_START][c]);
        m->earlier[0][c] = m->earlier[1][c] = m->at[AT_START][c].velocity;
        m->travel[c] = uniform(m->run->travels[c]);
    }
    truth found = {0};
    for (int n = 0; n < MOST_TURNS_TO_REST && !in_every(found); n++) {
        found |= settle(m, found) <= AT_REST;
    }
    find_forces(m, AT_START, m->travel);
    for (int c = 0; c < CORNERS; c++) {
        m->before[c] = m->force[AT_START][c];
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
        const real v = m->at[AT_START][c].velocity, f = m->force[AT_START][c];
        sum += v * v + f * f;
    }
    return sum < LARGEST * LARGEST;
}

static void march(March *m, const Sums *sums)
{
    const int has_travel = any_travel(m);
    int64_t left = m->run->every;
    for (int64_t k = 0; k < m->run->steps && in_any(m->alive); k++) {
        take_step(m, k, has_travel);
        accept(m);
        if (--left == 0) {
            const truth sensible = are_sensible(m);
            left = m->run->every;
            if (!in_every(sensible)) {
                retire(m, ~sensible, k, sums->ended);
            }
            record(m, sums);
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

EXPORTED int64_t number_of_setups(void)
{
    return SETUPS;
}

EXPORTED int64_t size_of_car(void)
{
    return (int64_t)sizeof(Car);
}

/* Runs SETUPS setups. `parameters` (CORNERS, PARAMETERS, SETUPS) and `laws` (CORNERS, SETUPS) are those of the shocks; `space` is for
 * the data of the run, at a multiple of 64. */
EXPORTED void run_machine(const Run *run, const double *parameters, const int64_t *laws, void *space, const Sums *sums)
{
    March *m = (March *)space;
    memset(m, 0, offsetof(March, ports));
    m->run = run;
    m->alive = ~(truth){0};
    for (int c = 0; c < CORNERS; c++) {
        Port *port = &m->ports[c];
        memcpy(&port->parameters, parameters + (size_t)c * PARAMETERS * SETUPS, PARAMETERS * sizeof(real));
        memcpy(&port->law, laws + (size_t)c * SETUPS, sizeof port->law);
        prepare_port(port, &run->car->friction[c], run->step);
    }
    for (int k = 0; k < SETUPS; k++) {
        sums->ended[k] = -1;
    }
    const truth found = start(m);
    retire(m, ~found, 0, sums->ended);
    record(m, sums);
    march(m, sums);
    report(m, sums);
}
