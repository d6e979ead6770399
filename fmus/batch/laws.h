/* Laws whose steps branch so much that they run setup by setup: Maxwell and Hysteresis, compiled from the files of their FMUs. */
#ifndef EIGHTPOST_LAWS_H
#define EIGHTPOST_LAWS_H

enum { LAW_PARAMETERS = 146, LAW_STATES = 2 };

/* One shock: its parameters in the order of component.h, its states, and factors that are kept. */
typedef struct {
    double parameters[LAW_PARAMETERS];
    double state[LAW_STATES];
    double kept[4 * 2 * 4];
} Law;

/* A piece of time in which the damper velocity [m/s] and F_s [N] change linearly; `count` pieces make a step. */
typedef struct {
    double velocity_start, static_start, velocity_end, static_end, step;
    int count;
} Span;

void maxwell_start(Law *law, double velocity, double static_force);
void maxwell_advance(Law *law, const Span *span);
double maxwell_force(const Law *law, double velocity, double static_force);
void hysteresis_start(Law *law, double velocity, double static_force);
void hysteresis_advance(Law *law, const Span *span);
double hysteresis_force(const Law *law, double velocity, double static_force);

#endif
