"""Couple FMUs of eightpost with fmpy alone, in a simple loop as in other tools (Gauss-Seidel, inputs held).

    python examples/fmpy_only.py car.fmu shock.fmu

The car uses the same shock FMU at all four corners. The left-front wheelloader rises by 10 mm at 0.1 s; the script
prints the left-front shock velocity and tire force. Build the FMUs with `eightpost build`; see examples/seven_dof.toml.
"""

import sys

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

CORNERS = ("lf", "rf", "lr", "rr")
STEP, STOP = 1e-3, 0.5


class Instance:
    """FMU instance whose variables are accessed by name."""

    def __init__(self, path, name):
        description = read_model_description(path)
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=extract(path),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def set(self, name, value):
        """Set a real variable."""
        self.fmu.setReal([self.references[name]], [value])

    def get(self, name):
        """Return a real variable."""
        return self.fmu.getReal([self.references[name]])[0]


def main(car_path, shock_path):
    """Run the loop; return the largest left-front shock velocity [m/s] and the final tire force change [N]."""
    car = Instance(car_path, "car")
    shocks = {corner: Instance(shock_path, corner) for corner in CORNERS}

    # In initialization mode, exchange forces and displacements until they agree (the coupled equilibrium).
    for _ in range(20):
        for corner, shock in shocks.items():
            shock.set("velocity", car.get(f"{corner}.velocity"))
            shock.set("displacement", car.get(f"{corner}.displacement"))
            car.set(f"{corner}.force", shock.get("force"))
    for instance in (car, *shocks.values()):
        instance.fmu.exitInitializationMode()
    start_force = car.get("lf.tire_force")

    fastest = 0.0
    for k in range(round(STOP / STEP)):
        time = k * STEP
        for corner, shock in shocks.items():
            car.set(f"{corner}.force", shock.get("force"))
        car.set("lf.road", 0.010 if time >= 0.1 else 0.0)
        car.fmu.doStep(time, STEP)
        for corner, shock in shocks.items():
            shock.set("velocity", car.get(f"{corner}.velocity"))
            shock.set("displacement", car.get(f"{corner}.displacement"))
            shock.fmu.doStep(time, STEP)
        fastest = max(fastest, car.get("lf.velocity"))
        if k % 50 == 0:
            print(f"{time + STEP:6.3f} s   {car.get('lf.velocity'):+8.4f} m/s   {car.get('lf.tire_force'):+10.1f} N")
    change = car.get("lf.tire_force") - start_force
    for instance in (car, *shocks.values()):
        instance.fmu.terminate()
        instance.fmu.freeInstance()
    return fastest, change


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    peak, moved = main(*sys.argv[1:])
    print(f"fastest {peak:.4f} m/s, tire force changed by {moved:.1f} N")
