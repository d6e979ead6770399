/* What assembly_data.h tells of an assembly: its parts, the vehicle first, and what feeds their inputs. */
#ifndef EIGHTPOST_WIRING_H
#define EIGHTPOST_WIRING_H

typedef struct {
    const char *name;
    int kind;
    int input_count, output_count, local_count;
    int outputs, locals; /* the first of each in Values.at of the assembly */
    int parameters; /* the first in Parameters.parameter of the assembly */
    int flags, flag_count; /* the first in Memory.flag of the assembly */
    int kept; /* the first number in Memory.state of the assembly */
    int feeds; /* of its first input */
    int signals, signal_count; /* the first of its outputs that feed another part */
} Place;

/* An output that feeds another part: forces of shocks first, then outputs of the vehicle. */
typedef struct {
    int part;
    int output;
} Coupled;

/* One part's input: the sum of some terms, and of an input of the assembly (-1: none). */
typedef struct {
    int first, last;
    int outside;
} Feed;

/* gain (factor signal + offset) */
typedef struct {
    int signal;
    double gain, factor, offset;
} Term;

#endif
