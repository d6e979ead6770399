/* What a batch runs: filled by Python (cosim/study/batch/library.py has the same structures). */
#ifndef EIGHTPOST_BATCH_H
#define EIGHTPOST_BATCH_H

#include <stdint.h>

#include "car.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* A recorded channel: output `number` of the vehicle, or signal `number` of PortSignals at a corner. */
typedef struct {
    int corner; /* -1: of the vehicle */
    int number;
} Channel;

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

/* An input of the vehicle: constant + force of a corner + factor * drive + offset. */
typedef struct {
    double constant, factor, offset;
    int corner, channel; /* -1: none */
} Input;

/* A limit of an output of the vehicle that is watched after settling: exceeded where sign * output > limit. */
typedef struct {
    double sign, limit;
    int output;
} Limit;

/* All setups of a run on a drive. */
typedef struct {
    const Car *car;
    const Input *inputs; /* INPUTS */
    const int *velocity_output, *displacement_output; /* CORNERS */
    const double *times, *steps; /* communication points, and the steps between them */
    const int64_t *recorded, *begins; /* whether a point is recorded; its place in the drive */
    const double *drive_times, *samples, *starts; /* the drive: a row of `channels` numbers for each of its points */
    const double *first_drive; /* at the start */
    const Channel *recorded_channels;
    const Quantity *quantities;
    const int *terms; /* of quantities: recorded channels */
    const double *weights;
    const Limit *limits;
    const int *series_channels; /* recorded channels whose series are stored */
    double settling;
    int64_t steps_count, drive_channels, follows, channel_count, quantity_count, limit_count, series_count;
} Run;

/* A filter of second-order sections: rows of six coefficients, the state of each for a unit step, and the rows of odd reflection at
 * each end. */
typedef struct {
    const double *rows, *rest;
    int64_t sections, pad;
} Filter;

/* Sums over a run, for each setup. */
typedef struct {
    double *residual, *transferred; /* CORNERS */
    double *defect, *total, *squares; /* 2 CORNERS: velocities, then forces */
    double *beyond; /* CORNERS: time beyond the fit [s] */
    double *watched; /* limits: time beyond each [s] */
    double *statistics; /* quantities, STATISTICS */
    double *series; /* rows, stored channels */
    int64_t *ended; /* the step at which a setup was retired, or -1 */
    int64_t *sweeps; /* of the equilibrium start */
    double *duration, *settled; /* of the run, and of the part after settling [s]; one number */
    int64_t *rows; /* recorded; one number */
} Sums;

#endif
