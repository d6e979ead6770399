/* What a machine runs, filled by Python (eightpost/machine/car.py has the same structures). */
#ifndef EIGHTPOST_MACHINE_H
#define EIGHTPOST_MACHINE_H

#include <stdint.h>

#include "car.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* A recorded signal of the shock at a corner; its number is one of port.h. */
typedef struct {
    int corner, number;
} Signal;

/* A quantity whose statistics are summed over the recorded rows `begin` to `end` - 1: a weighted sum of channels, or the product of
 * two. */
typedef struct {
    int first, count; /* terms */
    int is_product;
    int begin, end;
    int has_limits; /* whether the smallest and the largest value and the share inside are needed */
    double low, high; /* of the share of rows with low <= value < high */
} Quantity;

/* Statistics of a quantity, for each setup. */
enum { SHIFT, SUM, SQUARES, LEAST, LARGEST_VALUE, INSIDE, FIRST_VALUE, LAST_VALUE, STATISTICS };

/* A limit of an output of the vehicle that is watched after settling: exceeded where sign * output > limit. */
typedef struct {
    double sign, limit;
    int output; /* a recorded one */
} Limit;

/* All setups of a run on a drive. What the drive does to the car without forces beyond its dampers is the same for all of them. */
typedef struct {
    const Car *car;
    const number *velocities, *travels; /* of the ports by the drive: steps + 1 rows of CORNERS */
    const number *outputs; /* recorded outputs by the drive: a row of output_count numbers for each record */
    const number *output_rows; /* of recorded outputs, by the states and the forces beyond the dampers */
    const Signal *signals; /* after the outputs, these are the channels */
    const Quantity *quantities;
    const int *terms; /* of quantities: channels */
    const number *weights;
    const Limit *limits;
    const int *series; /* channels whose series are stored */
    double step;
    int64_t steps, every, settling; /* every: steps between records; settling: records at the start that limits do not count */
    int64_t output_count, signal_count, quantity_count, limit_count, series_count;
} Run;

/* The car's modes on a drive. Complex numbers are pairs, and `kinds` is the row of each interval between points. */
typedef struct {
    const double *into; /* of the modes by the inputs: input_count rows of STATES */
    const double *turn, *first, *last; /* rows of STATES: e^(lambda h), and weights of the loads at an interval's ends */
    const int32_t *kinds;
    const double *inputs; /* intervals + 1 rows of input_count */
    const int64_t *wanted; /* ascending numbers of the points whose outputs are needed */
    const double *rows; /* output_count rows of STATES */
    int64_t intervals, input_count, wanted_count, output_count;
} Driven;

/* Sums over a run, for each setup. */
typedef struct {
    double *transferred, *residual; /* CORNERS: work through the bond, and work that the coupling added [J] */
    double *defect, *total, *squares; /* 2 CORNERS, at records: velocities, then forces; defects of the last sweep and the quadratic */
    double *beyond; /* CORNERS: records beyond the fit */
    double *watched; /* limits: records beyond each */
    double *statistics; /* quantities, STATISTICS */
    number *values; /* rows, stored channels */
    int64_t *ended; /* the step at which a setup was retired, or -1 */
} Sums;

/* A filter of second-order sections: rows of six coefficients, the state of each for a unit step, and the rows of odd reflection at
 * each end. */
typedef struct {
    const double *rows, *rest;
    int64_t sections, pad;
} Filter;

#endif
