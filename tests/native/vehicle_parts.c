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

/* Real and imaginary parts of e^x, phi1(x) and phi2(x): in closed form, or by the series of x / 2^doublings. */
void exponentials_of(double re, double im, int doublings, double *parts)
{
    Lanes x;
    const double share = doublings < 0 ? 1.0 : 1.0 / (double)(1 << doublings);
    for (int i = 0; i < LANES; i++) {
        x.re[i] = i == LANES - 1 ? share * re : 0.0;
        x.im[i] = i == LANES - 1 ? share * im : 0.0;
    }
    const Exponentials a = doublings < 0 ? exponentials_in_closed_form(&x) : exponentials_by_series(&x, doublings);
    const Lanes *rows[] = {&a.e, &a.phi1, &a.phi2};
    for (int row = 0; row < 3; row++) {
        parts[2 * row] = rows[row]->re[LANES - 1];
        parts[2 * row + 1] = rows[row]->im[LANES - 1];
    }
}

int rounded_up(double count)
{
    return whole_number_above(count);
}
