// A C++ host in the manner of Project Chrono: the shock is a functor of a spring-damper link, which an implicit integrator
// evaluates in every iteration.
//
//     chrono_style CAR_FILE FMU_FOLDER LOOP STEP SECONDS RESULT_FILE        (as c_host.c; LOOP is C)
//
// Chrono asks such a functor for `evaluate(time, rest_length, length, vel)`, where `vel` is positive in extension and the
// force pushes the ends apart: the shock's velocity is -vel, its displacement is rest_length - length, and the force is
// its force as it is. Two things differ from an ordinary functor: the end of an accepted step must be reported
// (`accept`, after DoStepDynamics), and the time must be that of the trial point, the end of the step. The car is
// integrated by Newmark's method with average acceleration (HHT without damping), second order, with the Jacobian of the
// force law.
#include <ctime>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "car.h"
#include "force_law.h"

// What a host such as Chrono offers for user-defined forces.
class ForceFunctor {
  public:
    virtual ~ForceFunctor() = default;
    virtual double evaluate(double time, double rest_length, double length, double vel) = 0;
};

// The shock FMU as such a functor.
class ShockForce : public ForceFunctor {
  public:
    explicit ShockForce(const std::string &folder)
    {
        if (force_law_open(&law, folder.c_str(), "velocity", "displacement", "force") != 0) {
            const std::string reason = law.error;
            force_law_close(&law);
            throw std::runtime_error(reason);
        }
    }
    ~ShockForce() override { force_law_close(&law); }
    ShockForce(const ShockForce &) = delete;
    ShockForce &operator=(const ShockForce &) = delete;

    double start(double time, double rest_length, double length, double vel)
    {
        return checked(force_law_start(&law, time, -vel, rest_length - length, &force));
    }
    double evaluate(double time, double rest_length, double length, double vel) override
    {
        return checked(force_law_force(&law, time, -vel, rest_length - length, &force));
    }
    double accept(double time, double rest_length, double length, double vel)
    {
        return checked(force_law_accept(&law, time, -vel, rest_length - length, &force));
    }
    // Damping [N.s/m] and stiffness [N/m] of the shock, for the integrator's matrix.
    void jacobian(double time, double rest_length, double length, double vel, double &damping, double &stiffness)
    {
        checked(force_law_jacobian(&law, time, -vel, rest_length - length, &damping, &stiffness));
    }

  private:
    // A host that ignores a failure would go on with a force of zero.
    double checked(int status) const
    {
        if (status != 0) {
            throw std::runtime_error(law.error);
        }
        return force;
    }
    ForceLaw law;
    double force = 0.0;
};

// The car with four links, and its integrator.
class CarSystem {
  public:
    CarSystem(const std::string &file, const std::string &folder) : car(read_car(file.c_str()))
    {
        memcpy(state, car.start, sizeof car.start);
        double velocity[CORNERS], displacement[CORNERS];
        shock_motion(&car, state, velocity, displacement);
        for (int i = 0; i < CORNERS; i++) {
            shocks.emplace_back(new ShockForce(folder));
            force[i] = shocks[i]->start(0.0, REST_LENGTH, REST_LENGTH - displacement[i], -velocity[i]);
        }
        double slopes[STATES];
        slope(&car, 0.0, state, force, slopes);
        memcpy(acceleration, slopes + DOF, sizeof acceleration);
    }
    ~CarSystem() { free(car.track); }
    CarSystem(const CarSystem &) = delete;
    CarSystem &operator=(const CarSystem &) = delete;

    void do_step_dynamics(double h)
    {
        double trial[DOF], next[STATES];
        memcpy(trial, acceleration, sizeof trial);
        for (int iteration = 0; iteration < 20; iteration++) {
            for (int k = 0; k < DOF; k++) {
                next[k] = state[k] + h * state[DOF + k] + 0.25 * h * h * (acceleration[k] + trial[k]);
                next[DOF + k] = state[DOF + k] + 0.5 * h * (acceleration[k] + trial[k]);
            }
            if (correct(time + h, h, next, trial) < 1e-9) {
                break;
            }
        }
        time += h;
        memcpy(state, next, sizeof state);
        memcpy(acceleration, trial, sizeof acceleration);
        double velocity[CORNERS], displacement[CORNERS];
        shock_motion(&car, state, velocity, displacement);
        for (int i = 0; i < CORNERS; i++) {
            shocks[i]->accept(time, REST_LENGTH, REST_LENGTH - displacement[i], -velocity[i]);
        }
    }
    void write(FILE *file) const { record(file, &car, time, state); }

  private:
    // One Newton iteration for the acceleration at the end of the step; returns its largest change [m/s2].
    double correct(double end, double h, const double next[STATES], double trial[DOF])
    {
        double velocity[CORNERS], displacement[CORNERS], slopes[STATES], matrix[DOF][DOF + 1] = {{0.0}}, largest = 0.0;
        shock_motion(&car, next, velocity, displacement);
        for (int i = 0; i < CORNERS; i++) {
            const double length = REST_LENGTH - displacement[i];
            double damping, stiffness;
            force[i] = shocks[i]->evaluate(end, REST_LENGTH, length, -velocity[i]);
            shocks[i]->jacobian(end, REST_LENGTH, length, -velocity[i], damping, stiffness);
            const double weight = 0.5 * h * damping + 0.25 * h * h * stiffness;
            for (int k = 0; k < DOF; k++) {
                for (int j = 0; j < DOF; j++) {
                    matrix[k][j] += weight * car.strut[i][k] * car.strut[i][j];
                }
            }
        }
        slope(&car, end, next, force, slopes);
        for (int k = 0; k < DOF; k++) {
            matrix[k][k] += car.mass[k];
            for (int j = 0; j < DOF; j++) {
                matrix[k][j] += 0.25 * h * h * car.stiffness[k][j];
            }
            matrix[k][DOF] = car.mass[k] * (slopes[DOF + k] - trial[k]);
        }
        solve(matrix);
        for (int k = 0; k < DOF; k++) {
            trial[k] += matrix[k][DOF];
            largest = fabs(matrix[k][DOF]) > largest ? fabs(matrix[k][DOF]) : largest;
        }
        return largest;
    }
    // Gauss-Jordan elimination; the matrix is positive definite, so no pivoting is needed.
    static void solve(double matrix[DOF][DOF + 1])
    {
        for (int k = 0; k < DOF; k++) {
            for (int i = 0; i < DOF; i++) {
                const double factor = i == k ? 0.0 : matrix[i][k] / matrix[k][k];
                for (int j = k; j <= DOF; j++) {
                    matrix[i][j] -= factor * matrix[k][j];
                }
            }
        }
        for (int k = 0; k < DOF; k++) {
            matrix[k][DOF] /= matrix[k][k];
        }
    }

    static constexpr double REST_LENGTH = 0.4; // any length
    Car car;
    double time = 0.0, state[STATES] = {0.0}, acceleration[DOF] = {0.0}, force[CORNERS] = {0.0};
    std::vector<std::unique_ptr<ShockForce>> shocks;
};

constexpr double CarSystem::REST_LENGTH;

int main(int count, char **arguments)
{
    if (count != 7 || std::string(arguments[3]) != "C") {
        stop_with("usage: chrono_style CAR_FILE FMU_FOLDER C STEP SECONDS RESULT_FILE");
    }
    try {
        CarSystem system(arguments[1], arguments[2]);
        const double h = atof(arguments[4]);
        const long steps = static_cast<long>(atof(arguments[5]) / h + 0.5);
        FILE *file = fopen(arguments[6], "w");
        if (file == NULL) {
            stop_with("the result file cannot be written");
        }
        const clock_t began = clock();
        system.write(file);
        for (long n = 0; n < steps; n++) {
            system.do_step_dynamics(h);
            system.write(file);
        }
        printf("%g\n", 1e6 * static_cast<double>(clock() - began) / CLOCKS_PER_SEC / static_cast<double>(steps));
        return fclose(file);
    } catch (const std::exception &error) {
        stop_with(error.what());
    }
    return 1;
}
