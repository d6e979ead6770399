/* Calls every function of examples/hosts/force_law.h and prints the results, or the first error. */
#include "force_law.h"

static void print(ForceLaw *law, int status, const double *value)
{
    if (status != 0) {
        printf("error: %s\n", law->error);
    } else {
        printf("%.17g\n", *value);
    }
}

int main(int count, char **arguments)
{
    ForceLaw law;
    double force = 0.0, damping = 0.0, stiffness = 0.0;
#ifdef FORCE_LAW_PREFIX
    const unsigned references[3] = {0, 1, 2};
    const int opened = force_law_link(&law, arguments[1], references);
    (void)count;
#else
    const int opened = force_law_open(&law, arguments[1], count > 2 ? arguments[2] : "velocity", "displacement", "force");
#endif
    if (opened != 0) {
        print(&law, opened, &force);
        force_law_close(&law);
        return 0;
    }
    print(&law, force_law_force(&law, 0.0, 0.0, 0.0, &force), &force); /* not started */
#ifndef FORCE_LAW_PREFIX
    print(&law, force_law_parameter(&law, "compression_scale", 1.25), &force);
    print(&law, force_law_parameter(&law, "no_such", 1.0), &force);
#endif
    print(&law, force_law_start(&law, 0.5, 0.1, 0.01, &force), &force);
    print(&law, force_law_force(&law, 0.502, 0.2, 0.01, &force), &force);
    print(&law, force_law_force(&law, 0.5, -0.1, 0.01, &force), &force);
    print(&law, force_law_jacobian(&law, 0.501, 0.15, 0.01, &damping, &stiffness), &damping);
    print(&law, 0, &stiffness);
    print(&law, force_law_accept(&law, 0.501, 0.15, 0.012, &force), &force);
    print(&law, force_law_force(&law, 0.5, 0.1, 0.01, &force), &force);       /* backward */
    print(&law, force_law_force(&law, 0.502, NAN, 0.01, &force), &force);     /* not finite */
    print(&law, force_law_force(&law, 0.502, 1e300, 0.01, &force), &force);   /* refused */
    print(&law, force_law_force(&law, 0.503, 0.1, 0.01, &force), &force);
    print(&law, force_law_accept(&law, 0.503, 0.1, 0.01, &force), &force);    /* the last trial point */
    print(&law, force_law_start(&law, 0.0, 0.1, 0.01, &force), &force);       /* again */
    print(&law, force_law_hold(&law, 0.0, 0.001, 0.2, 0.01, &force), &force);
    print(&law, force_law_hold(&law, 0.001, 0.002, 0.3, 0.01, &force), &force);
    print(&law, force_law_hold(&law, 0.001, 0.002, 0.3, 0.01, &force), &force); /* begins too early */
    print(&law, force_law_start(&law, 0.0, 0.1, 0.01, &force), &force);
    print(&law, force_law_extrapolate(&law, 0.0, 0.001, 0.1, 0.01, &force), &force);
    print(&law, force_law_extrapolate(&law, 0.001, 0.001, 0.2, 0.01, &force), &force);
    print(&law, force_law_extrapolate(&law, 0.002, 0.002, 0.3, 0.01, &force), &force);
    force_law_close(&law);
    return 0;
}
