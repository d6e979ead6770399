/* The factors of a step: of every mode, e^(lambda h) and the weights of the inputs at both ends; and those of the coupled states. */
#ifndef EIGHTPOST_FACTORS_H
#define EIGHTPOST_FACTORS_H

#include "coupled.h"
#include "modal.h"
#include "phi.h"
#include "vehicle_data.h"

/* Number of doublings for a mode's exponent lambda h; beyond 32, exp, sin and cos are used. */
enum { MOST_DOUBLINGS = 6 };

static void keep_factors(Factors *f, int first, const Exponentials *a)
{
    for (int i = 0; i < LANES; i++) {
        f->e_re[first + i] = a->e.re[i];
        f->e_im[first + i] = a->e.im[i];
        f->first_re[first + i] = f->h * (a->phi1.re[i] - a->phi2.re[i]);
        f->first_im[first + i] = f->h * (a->phi1.im[i] - a->phi2.im[i]);
        f->second_re[first + i] = f->h * a->phi2.re[i];
        f->second_im[first + i] = f->h * a->phi2.im[i];
    }
}

static Lanes exponents(int first, double h)
{
    Lanes x;
    for (int i = 0; i < LANES; i++) {
        x.re[i] = SIGMA[first + i] * h;
        x.im[i] = OMEGA[first + i] * h;
    }
    return x;
}

static void discretise(Factors *f, double h)
{
    int doublings = 0;
    double part = h;
    while (doublings <= MOST_DOUBLINGS && FASTEST * part > 0.5) {
        doublings++;
        part *= 0.5;
    }
    f->h = h;
    for (int first = 0; first < MODES; first += LANES) {
        const int is_large = doublings > MOST_DOUBLINGS;
        const Lanes x = exponents(first, is_large ? h : part);
        const Exponentials a = is_large ? exponentials_in_closed_form(&x) : exponentials_by_series(&x, doublings);
        keep_factors(f, first, &a);
    }
    if (COUPLED_COUNT > 0) {
        discretise_coupled(f);
    }
}

#endif
