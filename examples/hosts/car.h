/* The seven-DOF car of the C and C++ host programs: the host's own part, without any FMU. */
#ifndef HOST_CAR_H
#define HOST_CAR_H

#include <stdio.h>
#include <stdlib.h>

enum { DOF = 7, CORNERS = 4, STATES = 14 };

typedef struct {
    double mass[DOF], stiffness[DOF][DOF], strut[CORNERS][DOF], tire[CORNERS], start[DOF], interval;
    long points;
    double *track;
} Car;

static inline void stop_with(const char *reason)
{
    fprintf(stderr, "%s\n", reason);
    exit(1);
}

static inline void read_numbers(FILE *file, double *numbers, long count)
{
    for (long k = 0; k < count; k++) {
        if (fscanf(file, "%lf", &numbers[k]) != 1) {
            stop_with("the file of the car ends too early");
        }
    }
}

static inline Car read_car(const char *path)
{
    Car car;
    double points;
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        stop_with("the file of the car cannot be read");
    }
    read_numbers(file, car.mass, DOF);
    read_numbers(file, car.stiffness[0], DOF * DOF);
    read_numbers(file, car.strut[0], CORNERS * DOF);
    read_numbers(file, car.tire, CORNERS);
    read_numbers(file, car.start, DOF);
    read_numbers(file, &car.interval, 1);
    read_numbers(file, &points, 1);
    car.points = (long)points;
    car.track = (double *)malloc(sizeof(double) * DOF * (size_t)car.points);
    if (car.track == NULL) {
        stop_with("no memory for the track");
    }
    read_numbers(file, car.track, DOF * car.points);
    fclose(file);
    return car;
}

/* Road under the four tires [m], then heave force, roll moment and pitch moment. */
static inline void drive(const Car *car, double time, double inputs[DOF])
{
    const double place = time / car->interval;
    const long last = car->points - 2, at = (long)(place + 1e-9), k = at < last ? at : last;
    for (int i = 0; i < DOF; i++) {
        const double from = car->track[DOF * k + i], to = car->track[DOF * (k + 1) + i];
        inputs[i] = from + (place - (double)k) * (to - from);
    }
}

static inline void shock_motion(const Car *car, const double state[STATES], double velocity[CORNERS], double displacement[CORNERS])
{
    for (int i = 0; i < CORNERS; i++) {
        velocity[i] = displacement[i] = 0.0;
        for (int k = 0; k < DOF; k++) {
            displacement[i] += car->strut[i][k] * state[k];
            velocity[i] += car->strut[i][k] * state[DOF + k];
        }
    }
}

static inline void slope(const Car *car, double time, const double state[STATES], const double force[CORNERS], double out[STATES])
{
    double inputs[DOF];
    drive(car, time, inputs);
    for (int k = 0; k < DOF; k++) {
        double pull = k < 3 ? inputs[CORNERS + k] : car->tire[k - 3] * inputs[k - 3];
        for (int j = 0; j < DOF; j++) {
            pull -= car->stiffness[k][j] * state[j];
        }
        for (int i = 0; i < CORNERS; i++) {
            pull -= car->strut[i][k] * force[i];
        }
        out[k] = state[DOF + k];
        out[DOF + k] = pull / car->mass[k];
    }
}

static inline void record(FILE *file, const Car *car, double time, const double state[STATES])
{
    double v[CORNERS], d[CORNERS], inputs[DOF];
    shock_motion(car, state, v, d);
    drive(car, time, inputs);
    fprintf(file, "%.17g", time);
    for (int i = 0; i < CORNERS; i++) {
        fprintf(file, " %.17g", v[i]);
    }
    for (int i = 0; i < CORNERS; i++) {
        fprintf(file, " %.17g", car->tire[i] * (inputs[i] - state[3 + i]));
    }
    fputc('\n', file);
}

#endif
