/* A C program as the host: the seven-DOF car, integrated with a Runge-Kutta method of fourth order, and four shock FMUs.

       c_host CAR_FILE FMU_FOLDER LOOP STEP SECONDS RESULT_FILE

   CAR_FILE has the numbers that c_host.py writes: the diagonal of M (7), K (7, 7), S (4, 7), tire stiffnesses (4), q at
   the start (7), and the track: interval [s], number of points, points (7 each). FMU_FOLDER is the unpacked shock FMU,
   LOOP is A, B or C, STEP and SECONDS are in s. RESULT_FILE gets a line for each step: time, shock velocities (4),
   changes of the tire forces (4). The last line printed is the processor time of a step of the host [us]. */
#include <time.h>

#include "car.h"
#include "force_law.h"

static void must(const ForceLaw *law, int status)
{
    if (status != 0) {
        stop_with(law->error);
    }
}

/* ---- The loops: what a host adds for the FMUs ---------------------------------------------------------------------------- */

/* Before a step: loops A and B compute the force that is held over it. */
static void before_step(ForceLaw laws[], const Car *car, char loop, double time, double h, const double state[STATES],
                        double force[CORNERS])
{
    double v[CORNERS], d[CORNERS];
    shock_motion(car, state, v, d);
    for (int i = 0; i < CORNERS; i++) {
        if (loop == 'A') {
            must(&laws[i], force_law_hold(&laws[i], time, h, v[i], d[i], &force[i]));
        } else if (loop == 'B') {
            must(&laws[i], force_law_extrapolate(&laws[i], time, h, v[i], d[i], &force[i]));
        }
    }
}

/* In every stage, and with `accepted` after every step: loop C computes the force there. */
static void at_point(ForceLaw laws[], const Car *car, int accepted, double time, const double state[STATES],
                     double force[CORNERS])
{
    double v[CORNERS], d[CORNERS];
    shock_motion(car, state, v, d);
    for (int i = 0; i < CORNERS; i++) {
        must(&laws[i], accepted ? force_law_accept(&laws[i], time, v[i], d[i], &force[i])
                                : force_law_force(&laws[i], time, v[i], d[i], &force[i]));
    }
}

static void runge_kutta(ForceLaw laws[], const Car *car, char loop, double time, double h, double state[STATES])
{
    static const double reach[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    double force[CORNERS], trial[STATES], slopes[STATES] = {0.0}, sum[STATES] = {0.0};
    before_step(laws, car, loop, time, h, state, force);
    for (int stage = 0; stage < 4; stage++) {
        for (int k = 0; k < STATES; k++) {
            trial[k] = state[k] + reach[stage] * h * slopes[k];
        }
        if (loop == 'C') {
            at_point(laws, car, 0, time + reach[stage] * h, trial, force);
        }
        slope(car, time + reach[stage] * h, trial, force, slopes);
        for (int k = 0; k < STATES; k++) {
            sum[k] += weight[stage] * slopes[k];
        }
    }
    for (int k = 0; k < STATES; k++) {
        state[k] += h * sum[k];
    }
    if (loop == 'C') {
        at_point(laws, car, 1, time + h, state, force);
    }
}

int main(int count, char **arguments)
{
    ForceLaw laws[CORNERS];
    double state[STATES] = {0.0}, v[CORNERS], d[CORNERS], force[CORNERS];
    if (count != 7 || strchr("ABC", arguments[3][0]) == NULL) {
        stop_with("usage: c_host CAR_FILE FMU_FOLDER A|B|C STEP SECONDS RESULT_FILE");
    }
    Car car = read_car(arguments[1]);
    const double h = atof(arguments[4]);
    const long steps = (long)(atof(arguments[5]) / h + 0.5);
    FILE *file = fopen(arguments[6], "w");
    if (file == NULL || !(h > 0.0)) {
        stop_with("the result file cannot be written, or the step is not positive");
    }
    memcpy(state, car.start, sizeof car.start);
    shock_motion(&car, state, v, d);
    for (int i = 0; i < CORNERS; i++) {
        must(&laws[i], force_law_open(&laws[i], arguments[2], "velocity", "displacement", "force"));
        must(&laws[i], force_law_start(&laws[i], 0.0, v[i], d[i], &force[i]));
    }
    const clock_t began = clock();
    for (long n = 0; n < steps; n++) {
        record(file, &car, (double)n * h, state);
        runge_kutta(laws, &car, arguments[3][0], (double)n * h, h, state);
    }
    record(file, &car, (double)steps * h, state);
    printf("%g\n", 1e6 * (double)(clock() - began) / CLOCKS_PER_SEC / (double)steps);
    for (int i = 0; i < CORNERS; i++) {
        force_law_close(&laws[i]);
    }
    free(car.track);
    return fclose(file) == 0 ? 0 : 1;
}
