/* Invalid numbers, passed below every check of an FMU's interface: compiled together with its sources/ under
 * sanitizers.
 *
 *     odd_numbers
 *
 * The elementary functions of NaN return NaN. A step from a memory with one invalid number ends, refused or
 * not: no index and no count is computed from an unchecked number. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "component.h"
#include "elementary.h"

static const double ODD[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e150, -1e20, -1.0, 5e-324, 0.0};
enum { ODDS = sizeof ODD / sizeof ODD[0] };

static void expect(int is_so, const char *what)
{
    if (!is_so) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

static void try_functions(void)
{
    double sine, cosine;
    expect(isnan(exponential(NAN)), "exponential(NaN) is a number");
    expect(isnan(exponential_minus_1(NAN)), "exponential_minus_1(NaN) is a number");
    expect(isnan(hyperbolic_tangent(NAN)), "hyperbolic_tangent(NaN) is a number");
    expect(exponential(INFINITY) == INFINITY && exponential(-INFINITY) == 0.0, "exponential(infinity)");
    expect(hyperbolic_tangent(INFINITY) == 1.0 && hyperbolic_tangent(-INFINITY) == -1.0, "hyperbolic_tangent(infinity)");
    for (int k = 0; k < ODDS; k++) {
        sine_and_cosine(ODD[k], &sine, &cosine);
        expect(isnan(ODD[k]) ? isnan(sine) && isnan(cosine) : fabs(sine) <= 1.0 && fabs(cosine) <= 1.0, "sine_and_cosine");
    }
}

static void start(Memory *m, void *work)
{
    Message why = {.length = 0};
    memset(m, 0, sizeof *m);
    memcpy(m->values.at, start_values, sizeof m->values.at);
    memcpy(m->flag, start_flags, sizeof m->flag);
    m->phase = STEPPING;
    m->stop = NO_LIMIT;
    expect(model_start(m, work, &why), "the model does not start");
}

static void step_with(const Memory *begin, double *number, Memory *trial, double odd, double from0, void *work)
{
    double from[INPUTS];
    Message why = {.length = 0};
    *trial = *begin;
    *number = odd;
    memcpy(from, trial->values.at, sizeof from);
    from[0] += from0;
    model_step(trial, from, 1e-3, work, &why);
}

int main(void)
{
    Memory begin, trial;
    void *work = calloc(1, model_work_size() + 1);
    try_functions();
    start(&begin, work);
    for (int k = 0; k < STATES + REALS; k++) {
        for (int odd = 0; odd < ODDS; odd++) {
            double *number = k < STATES ? &trial.state[k] : &trial.values.at[k - STATES];
            step_with(&begin, number, &trial, ODD[odd], 0.0, work);
            step_with(&begin, number, &trial, ODD[odd], 0.5, work);
        }
    }
    free(work);
    return 0;
}
