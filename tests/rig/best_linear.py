"""The best linear model of a car on the virtual rig, for tests: local polynomials, then the closed loop by frequency.

With linear dampers at the ports the shock-force difference is D v, so that line by line

    v = (I - H_vF D)^-1 H_vu u,  y = H_yu u + H_yF D v

No rational fit, no sampling, no noise: what this misses, every linear model of these records misses.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import decimate

from eightpost.ident.vehicle.estimators import LocalPolynomial, estimate_response
from eightpost.rig.post import Actuators, LinearDamper, Run, random_drive, simulate, simulate_setups, track_drive
from eightpost.rig.post.car import ride_heights
from eightpost.rig.post.drivefiles import RATE
from eightpost.signals import TimeSeries
from eightpost.units import convert

DAMPING = convert(1.0, "lbf.s/in", "N.s/m")
#: Baseline and alternate shocks (6.1.4) [lbf.s/in].
BASELINE, ALTERNATE = 20.0, 9.0
#: Maximum frequency of the drive [Hz] (Table 6.3), and duration of the settling that is left out [s].
HIGH, SETTLING = 30.0, 2.0


def forces(car):
    return car.named("force")


def outputs(car, motion):
    """Return shock velocities, tire forces, ride heights and hub accelerations of a motion, by name: (unit, row)."""
    rows = {"velocity": car.shock @ motion.velocity, "tire_force": motion.tire_force}
    rows["hub_acceleration"] = car.wheel @ motion.acceleration
    units = {"velocity": "m/s", "tire_force": "N", "hub_acceleration": "m/s2"}
    heave, pitch = (car.points[name] @ motion.position for name in ("heave", "pitch"))
    heights = ride_heights(heave, pitch, motion.drive[:4], car.geometry)
    named = {n: (units[q], row) for q, part in rows.items() for n, row in zip(car.named(q), part, strict=True)}
    ends = zip(("front", "rear"), heights, strict=True)
    return named | {f"{end}.ride_height": ("m", row) for end, row in ends}


def linear_model(car, *, duration=100.0, seed=1):
    """Return the response of a car, estimated from its baseline and alternate tests without noise."""
    drive = Actuators().follow(random_drive(car, seed, duration=duration).series, car)
    baseline, alternate = LinearDamper(BASELINE * DAMPING), LinearDamper(ALTERNATE * DAMPING)
    runs = [Run(drive, tuple(alternate if c == k else baseline for c in range(4))) for k in range(-1, 4)]
    records = [_record(car, motion) for motion in simulate(car, runs)]
    names = [name for name in records[0].names if name not in (*car.inputs, *forces(car))]
    return estimate_response(
        records,
        inputs=[*car.inputs, *forces(car)],
        outputs=names,
        # The aeroloaders have no power above 5 Hz, except for spectral leakage, which is removed.
        recipe=LocalPolynomial(high=HIGH, spacing=0.1, power_floor=0.03),
        baseline_damping=dict.fromkeys(car.corners, BASELINE * DAMPING),
    )


def _record(car, motion):
    units = [*("m",) * 4, *car.load_units]
    channels = dict(zip(car.inputs, zip(units, motion.drive, strict=True), strict=True))
    channels |= {n: ("N", row) for n, row in zip(forces(car), motion.shock_force, strict=True)}
    channels |= outputs(car, motion)
    rows = decimate(np.stack([row for _, row in channels.values()]), 10, ftype="fir", axis=1)
    thinned = {n: (unit, row) for (n, (unit, _)), row in zip(channels.items(), rows, strict=True)}
    return TimeSeries.from_channels(np.arange(rows.shape[1]) * 10.0 / RATE, thinned)


def relative_errors(car, response, setups, *, seed, duration):
    """Return the errors [%] of the RMS measures (setups, 15) of the linear model over a lap, relative to the truth.

    Args:
        car: The truth.
        response: Response returned by `linear_model`.
        setups: Dampings [lbf.s/in] of four linear dampers each.
        seed: Seed of the lap.
        duration: Duration of the lap [s].
    """
    lap = Actuators().follow(track_drive(car, seed, duration=duration).series, car)
    banks = [tuple(LinearDamper(c * DAMPING) for c in setup) for setup in setups]
    truth = []
    for motion in simulate_setups(car, lap, banks):
        known = outputs(car, motion)
        truth.append(_measures(response.output_names, np.stack([known[n][1] for n in response.output_names])))
    predicted = [_measures(response.output_names, rows) for rows in _predicted(car, response, lap, setups)]
    return 100.0 * (np.array(predicted) / np.array(truth) - 1.0)


def _measures(names, rows):
    """Return the RMS of the outputs (p, N) and of the sum of the tire forces, up to HIGH and without the settling."""
    lines = np.fft.rfft(rows - rows.mean(axis=1, keepdims=True), axis=1)
    lines[:, np.fft.rfftfreq(rows.shape[1], 1.0 / RATE) > HIGH] = 0.0
    settled = np.fft.irfft(lines, rows.shape[1], axis=1)[:, round(SETTLING * RATE) :]
    total = sum(row for name, row in zip(names, settled, strict=True) if name.endswith("tire_force"))
    return np.std(np.vstack([settled, total]), axis=1)


def _predicted(car, response, lap, setups):
    """Return the outputs (p, N) of the linear model per setup; the lap starts at rest and fades out after its end."""
    u = np.stack([lap[name] for name in car.inputs])
    u -= u[:, :1]
    fade = np.where(np.arange(20 * 1250) < 1250, 0.5 + 0.5 * np.cos(np.pi * np.arange(20 * 1250) / 1250), 0.0)
    whole = np.concatenate([u, u[:, -1:] * fade], axis=1)
    frequency = np.fft.rfftfreq(whole.shape[1], 1.0 / RATE)
    frequency = frequency[frequency <= HIGH]
    lines = np.fft.rfft(whole, axis=1)[:, : frequency.size]
    H = np.moveaxis(_interpolated(response, frequency), -1, 0)
    ports = [response.output_names.index(name) for name in car.named("velocity")]
    for setup in setups:
        feedback = np.diag((np.array(setup) - BASELINE) * DAMPING)
        loop = np.eye(4) - H[:, ports, 8:] @ feedback
        driven = (H[..., :8] @ lines.T[..., None])[..., 0]
        v = np.linalg.solve(loop, driven[:, ports, None])
        y = driven + (H[..., 8:] @ feedback @ v)[..., 0]
        padded = np.zeros((y.shape[1], whole.shape[1] // 2 + 1), dtype=complex)
        padded[:, : frequency.size] = y.T
        yield np.fft.irfft(padded, whole.shape[1], axis=1)[:, : u.shape[1]]


def _interpolated(response, frequency):
    flat = response.H.reshape(-1, response.frequency.size)
    rows = [
        np.interp(frequency, response.frequency, h.real) + 1j * np.interp(frequency, response.frequency, h.imag)
        for h in flat
    ]
    return np.array(rows).reshape(*response.H.shape[:2], -1)
