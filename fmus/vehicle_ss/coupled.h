/* The factors of a step of the coupled states: with X = h COUPLING, the matrices e^X, h (phi1(X) - phi2(X)) and h phi2(X), by the
 * series and the doublings of phi.h. */
#ifndef EIGHTPOST_COUPLED_H
#define EIGHTPOST_COUPLED_H

#include <string.h>

#include "modal.h"
#include "phi.h"
#include "vehicle_data.h"

/* f->product = share a b + rest c + number I. */
static void multiply(Factors *f, double share, const double *a, const double *b, double rest, const double *c, double number)
{
    for (int row = 0; row < COUPLED; row++) {
        for (int column = 0; column < COUPLED; column++) {
            double sum = 0.0;
            for (int k = 0; k < COUPLED; k++) {
                sum += a[row * COUPLED + k] * b[k * COUPLED + column];
            }
            f->product[row * COUPLED + column] =
                share * sum + rest * c[row * COUPLED + column] + (row == column ? number : 0.0);
        }
    }
}

static void take_product(const Factors *f, double *matrix)
{
    memcpy(matrix, f->product, sizeof f->product);
}

static void discretise_coupled(Factors *f)
{
    double *e = f->coupled_e, *phi1 = f->coupled_first, *phi2 = f->coupled_second, part = f->h;
    int doublings = 0;
    while (FASTEST_COUPLED * part > 0.5) {
        doublings++;
        part *= 0.5;
    }
    memset(phi2, 0, sizeof f->coupled_second);
    for (int k = SERIES_TERMS - 1; k >= 0; k--) {
        multiply(f, part, COUPLING, phi2, 0.0, phi2, PHI2[k]);
        take_product(f, phi2);
    }
    multiply(f, part, COUPLING, phi2, 0.0, phi2, 1.0);
    take_product(f, phi1);
    multiply(f, part, COUPLING, phi1, 0.0, phi1, 1.0);
    take_product(f, e);
    for (int k = 0; k < doublings; k++) {
        multiply(f, 0.25, phi1, phi1, 0.5, phi2, 0.0);
        take_product(f, phi2);
        multiply(f, 0.5, phi1, e, 0.5, phi1, 0.0);
        take_product(f, phi1);
        multiply(f, 1.0, e, e, 0.0, e, 0.0);
        take_product(f, e);
    }
    for (int k = 0; k < COUPLED_CELLS; k++) {
        phi1[k] = f->h * (phi1[k] - phi2[k]);
        phi2[k] *= f->h;
    }
}

#endif
