/* Internal functions of fmus/vehicle_ss/model.c, for tests/native/test_vehicle_parts.py. */
#include "model.c"

int mode_count(void)
{
    return MODE_COUNT;
}

int state_count(void)
{
    return STATE_COUNT;
}

void eigenvalues(double *sigma, double *omega)
{
    memcpy(sigma, SIGMA, MODE_COUNT * sizeof *sigma);
    memcpy(omega, OMEGA, MODE_COUNT * sizeof *omega);
}

/* Real and imaginary parts of e^(lambda h), h (phi1 - phi2) and h phi2 of every mode. */
void factors_of_step(double h, double *parts)
{
    Factors f;
    discretise(&f, h);
    const double *rows[] = {f.e_re, f.e_im, f.first_re, f.first_im, f.second_re, f.second_im};
    for (int row = 0; row < 6; row++) {
        memcpy(parts + row * MODE_COUNT, rows[row], MODE_COUNT * sizeof *parts);
    }
}

int is_sound_with(int place, double value)
{
    Modal z = {{0.0}};
    z.at[place] = value;
    return is_sound(&z);
}
