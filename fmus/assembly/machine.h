/* The parts of an instance while they are started or stepped, and functions shared between the files of an assembly. */
#ifndef EIGHTPOST_MACHINE_H
#define EIGHTPOST_MACHINE_H

#include "assembly_data.h"
#include "component.h"
#include "part.h"
#include "real.h"

#define kept_of fmi2FullName(kept_of)
#define unpack fmi2FullName(unpack)
#define pack fmi2FullName(pack)
#define add_part_message fmi2FullName(add_part_message)
#define read_part fmi2FullName(read_part)
#define feed fmi2FullName(feed)
#define evaluate_part fmi2FullName(evaluate_part)
#define settle fmi2FullName(settle)
#define add_defects fmi2FullName(add_defects)
#define local_error fmi2FullName(local_error)
#define worst_error fmi2FullName(worst_error)
#define are_sound fmi2FullName(are_sound)

/* Layout of Memory.state: the data of each part (PARTS_KEEP numbers), then the coupled signals and their slopes, then the error
 * estimators of the forces, and the time since their start. */
enum {
    NOW = PARTS_KEEP,
    SLOPE = NOW + COUPLED,
    DEFECT = SLOPE + COUPLED,
    MEAN = DEFECT + FORCES,
    SPREAD = MEAN + FORCES,
    DURATION = SPREAD + FORCES
};

/* The position of each part in the work space, and the coupled signals. */
typedef struct {
    void *part[PARTS];
    double *values[PARTS];
    double now[COUPLED]; /* at the start of the micro step */
    double slope[COUPLED]; /* over the last micro step [1/s] */
    double ahead[COUPLED]; /* at the end of the micro step, for parts that have stepped */
} Machine;

/* The saved data of part p. */
Kept kept_of(const Memory *memory, int p);
void unpack(Machine *m, const Memory *memory, void *work);
/* Saves the parts, and copies their outputs and local variables. */
void pack(const Machine *m, Memory *memory);
/* Reports why part p failed, or that its result is not finite. */
void add_part_message(int p, const Message *message, Message *why);
/* Updates the coupled outputs of part p. */
void read_part(Machine *m, int p);
/* The inputs of part p at both ends of a micro step of h [s]; the vehicle's outputs are known at its end, forces are extrapolated
 * with their slope. */
void feed(const Machine *m, int p, const double *outside0, const double *outside1, double h, double *from, double *to);

/* Evaluates part p with the coupled signals now, and reads its own (rates.c); 0 if a result is not finite. */
int evaluate_part(Machine *m, int p, const double *outside, Message *why);

/* Starts the parts with shock forces that are consistent with the vehicle's state under them (coupled_start.c); 0 if there are no
 * such forces. */
int settle(Machine *m, const double *outside, Message *why);

/* Adds a micro step of h [s] to the error estimators of the forces (coupling_error.c). */
void add_defects(const Machine *m, double *state, double h);
/* Root mean square of the error of force s since the start [N]. */
double local_error(const double *state, int s);
/* Whether the coupled signals, their slopes and the error estimators are finite: squares overflow long before forces do. */
int are_sound(const Machine *m, const double *state);
/* Coupling error of the worst force [%]. */
double worst_error(const double *state);

#endif
