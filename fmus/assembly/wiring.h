/* Tables of an assembly in assembly_data.h: its parts, the vehicle first, and the sources of their inputs. */
#ifndef EIGHTPOST_WIRING_H
#define EIGHTPOST_WIRING_H

typedef struct {
    const char *name;
    int kind;
    int input_count, output_count, local_count;
    int outputs, locals; /* index of the first one of each in Values.at of the assembly */
    int parameters; /* index of the first one in Parameters.parameter of the assembly */
    int flags, flag_count; /* index of the first one in Memory.flag of the assembly */
    int kept; /* index of the first number in Memory.state of the assembly */
    int feeds; /* index of the feed of its first input */
    int signals, signal_count; /* index of the first of its outputs that feed another part */
    int states; /* index of the first one of its continuous states */
} Place;

/* An output that feeds another part: forces of shocks first, then outputs of the vehicle. */
typedef struct {
    int part;
    int output;
} Coupled;

/* The source of one part's input: a sum of terms, and an input of the assembly (-1: none). */
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
