"""Vehicles with a structural or an identified model, and their files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, asdict, astuple, dataclass, field, fields, replace
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, NotRequired

import numpy as np
from pydantic import AfterValidator, BeforeValidator
from pydantic_core import PydanticCustomError
from scipy.constants import g
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

import eightpost
from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, InputError, ParameterError
from eightpost.files import atomic_path, json_content, parse_toml, read_text
from eightpost.schema import document_of, object_of
from eightpost.toml_document import in_unit, parse_model
from eightpost.validity import Validity
from eightpost.vehicle.friction import Bristle
from eightpost.vehicle.statespace import Channel, StateSpace, add_port_damping, add_port_stiffness
from eightpost.vehicle.structural import Corners, QuarterCar, SevenDof

# ==== Vehicles ========================================================================================================

Model = Literal["quarter_car", "seven_dof", "state_space"]

#: Largest rates of growth of a motion [1/s]: with the baseline dampers it grows by half in a minute at most, and
#: without any, shocks in a loop with a delay of a millisecond still hold it.
GROWTH_WITH_DAMPERS, GROWTH_WITHOUT = 0.007, 100.0


@dataclass(frozen=True, slots=True, repr=False)
class StructuralVehicle(Summarized):
    """Vehicle that is defined by its masses, springs and dampers."""

    name: str  #: Name of the vehicle.
    parameters: QuarterCar | SevenDof  #: Parameters, SI.
    #: Values of the static state by output, SI: `{"lf.tire_force": 3300.0, "front.ride_height": 0.1}`. Outputs of the
    #: model are changes from it; the FMU adds it. Missing values are 0.
    static: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "static", _check_static(self.static, self.coupled().output_names, self.name))

    def _summary(self) -> Summary:
        p, model = self.parameters, self.coupled()
        unsprung = p.unsprung_mass if isinstance(p, QuarterCar) else sum(p.unsprung_mass)
        return Summary.of(
            f"Vehicle {self.name}: {self.model}",
            ("masses", f"{p.sprung_mass:.4g} kg sprung, {unsprung:.4g} kg unsprung"),
            ("inputs", some(model.input_names)),
            ("outputs", some(model.output_names)),
            ("static state", some(f"{name} {value:.4g}" for name, value in self.static.items() if value)),
        )

    @property
    def model(self) -> Model:
        """Return the kind of model, the value of `model` in the file."""
        return "quarter_car" if isinstance(self.parameters, QuarterCar) else "seven_dof"

    def coupled(self) -> StateSpace:
        """Return the model without its own dampers, whose inputs are the whole shock forces."""
        return self.parameters.coupled()

    def with_damper(self) -> StateSpace:
        """Return the model with its linear dampers, for frequency responses and modes."""
        return self.parameters.with_damper()


def _check_static(static: Mapping[str, float], outputs: Sequence[str], where: str) -> dict[str, float]:
    """Return a copy of a static state; ParameterError: a value is not finite, or its output has no static part."""
    with_static = [name for name in outputs if name.endswith(("tire_force", "ride_height"))]
    for name, value in static.items():
        if name not in with_static:
            raise ParameterError(
                f"{where}: a static value is given for {name!r}; this model has static values of "
                f"{', '.join(with_static)}"
            )
        if not isfinite(value):
            raise ParameterError(f"{where}: the static {name} is {value}; give a finite number")
    return {name: float(value) for name, value in static.items()}


class Friction(NamedTuple):
    """Friction and progressive spring at a port; their force is added to the shock force.

        F_f tanh(v / v_f) + F_s z / z_s + k2 d^2

    with the velocity v and the displacement d of the port, and the bristle's deflection z. The identified model is the
    car about the mean loads of its tests, and d is zero there. Without loads, d is `-mean_travel`; the car about that
    state (`IdentifiedVehicle.unloaded`) has the same spring k2 d^2 with its own d, and a stiffness that is lower by
    `2 k2 mean_travel`.
    """

    force: float = 0.0  #: Friction force F_f of the part that creeps [N], not below zero.
    velocity: float = 0.005  #: Smoothing velocity v_f of the change of sign [m/s], above zero.
    bristle: Bristle = Bristle()  #: The part that sticks; its default has no force.
    #: Coefficient k2 of the port spring [N/m2]: a spring that is stiffer in compression has a positive one.
    spring: float = 0.0
    #: Displacement from the state without loads to the mean of the tests [m]; it matters for a spring only.
    mean_travel: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether any element has a force."""
        return self.force > 0.0 or self.bristle.force > 0.0 or self.spring != 0.0

    @property
    def sliding_force(self) -> float:
        """Friction force of a port that slides [N]."""
        return self.force + self.bristle.force

    def fault(self) -> str | None:
        """Return what is wrong with the values, None if they are valid."""
        force, velocity, bristle, spring, mean_travel = self
        for name, value, is_in_range, limits in (
            ("force", force, force >= 0.0, "N, not below zero"),
            ("velocity", velocity, velocity > 0.0, "m/s, above zero"),
            ("bristle.force", bristle.force, bristle.force >= 0.0, "N, not below zero"),
            ("bristle.reach", bristle.reach, bristle.reach > 0.0, "m, above zero"),
            ("bristle.static_ratio", bristle.static_ratio, bristle.static_ratio >= 1.0, "at least 1"),
            (
                "bristle.stribeck_velocity",
                bristle.stribeck_velocity,
                bristle.stribeck_velocity > 0.0,
                "m/s, above zero",
            ),
            ("spring", spring, True, "N/m2"),
            ("mean_travel", mean_travel, True, "m"),
        ):
            if not (isfinite(value) and is_in_range):
                return f"{name} is {value!r}; give a finite number [{limits}]"
        return None


def _stated(law: Friction) -> dict[str, Any]:
    """Return the values that are not the defaults of their fields: a later version may have further fields."""
    values, usual = ({**one._asdict(), "bristle": asdict(one.bristle)} for one in (law, Friction()))
    return {name: value for name, value in values.items() if value != usual[name]}


def _plain(law: Friction) -> Friction:
    """Return the same law with Python's numbers."""
    bristle = Bristle(*(float(value) for value in astuple(law.bristle)))
    return Friction(float(law.force), float(law.velocity), bristle, float(law.spring), float(law.mean_travel))


@dataclass(frozen=True, slots=True, repr=False)
class IdentifiedVehicle(Summarized):
    """Vehicle that is defined by an identified linear model."""

    name: str  #: Name of the vehicle.
    #: Identified model, around the baseline damping: its shock inputs are shock force minus `c v`.
    state_space: StateSpace
    #: Damping rate c by port [N.s/m] ("lf", ...; "" for a quarter car), the dissertation's C-bar. The input of a port
    #: that is missing here is the whole force.
    baseline_damping: Mapping[str, float] = field(default_factory=dict)
    #: Values of the static state by output, SI; see `StructuralVehicle`.
    static: Mapping[str, float] = field(default_factory=dict)
    #: SHA-256 digests of the files that the vehicle was identified from, by name.
    sources: Mapping[str, str] = field(default_factory=dict)
    #: Friction and springs by port; the shock forces of the identification included them. Missing ports have none.
    friction: Mapping[str, Friction] = field(default_factory=dict)
    #: Verdict on the model and the ranges that it covers; None if they are not known. It is "unknown" if `numbers` are
    #: not those that were judged.
    validity: Validity | None = None

    def __post_init__(self) -> None:
        names = self.state_space.output_names
        object.__setattr__(self, "static", _check_static(self.static, names, self.name))
        object.__setattr__(self, "baseline_damping", {k: float(v) for k, v in self.baseline_damping.items()})
        object.__setattr__(self, "sources", dict(self.sources))
        friction = {k: _plain(v) for k, v in self.friction.items()}
        object.__setattr__(self, "friction", friction)
        self._check_ports("baseline damping", self.baseline_damping)
        self._check_ports("friction", self.friction)
        for port, law in friction.items():
            if (fault := law.fault()) is not None:
                raise ParameterError(f"{self.name}: the friction of the port {port!r} is invalid: {fault}")
            if law.spring and channel(port, "displacement") not in names:
                raise ParameterError(
                    f"{self.name}: the port {port!r} has a spring of {law.spring!r} N/m2, but the model has no output "
                    f"{channel(port, 'displacement')}; identify that output, or remove the spring"
                )
        if self.validity is not None:
            object.__setattr__(self, "validity", self.validity.checked(self.numbers, self.name))

    @property
    def numbers(self) -> Mapping[str, Any]:
        """All that the verdict is about: model, channels, damping, static state, friction, records."""
        model = self.state_space
        return {
            **{name: getattr(model, name).tolist() for name in ("A", "B", "C", "D")},
            "dt": model.dt,
            "channels": [(one.name, one.unit) for one in (*model.inputs, *model.outputs)],
            "baseline_damping": self.baseline_damping,
            "static": self.static,
            "friction": {port: _stated(law) for port, law in self.friction.items()},
            "records": sorted(self.sources.values()),
        }

    def _summary(self) -> Summary:
        verdict = self.validity.verdict if self.validity else None
        model = self.state_space
        damping = (f"{port or 'port'} {value:.4g} N.s/m" for port, value in self.baseline_damping.items())
        friction = (f"{port or 'port'} {law.sliding_force:.3g} N" for port, law in self.friction.items() if law.acts)
        return Summary.of(
            f"Identified vehicle {self.name}",
            ("verdict", verdict.headline if verdict else "not stated"),
            ("reason", str(verdict.decisive[0]) if verdict and verdict.reasons else ""),
            ("model", f"{len(model.A)} states"),
            ("inputs", some(model.input_names)),
            ("outputs", some(model.output_names)),
            ("baseline damping", some(damping)),
            ("friction", some(friction)),
        )

    def _check_ports(self, what: str, given: Iterable[str]) -> None:
        inputs = self.state_space.input_names
        ports = [name.removesuffix("force").rstrip(".") for name in inputs]
        for port in given:
            if port not in ports:
                raise ParameterError(
                    f"{self.name}: {what} is given for the port {port!r}, but it has no force input; the inputs are "
                    f"{', '.join(inputs)}"
                )

    @property
    def model(self) -> Model:
        """Return the kind of model, the value of `model` in the file."""
        return "state_space"

    def coupled(self) -> StateSpace:
        """Return the model without the baseline damping, whose inputs are the whole shock forces and loads.

        It is the car about the state without loads; see `unloaded`.

        Raises:
            ParameterError: The model is discrete, or a shock velocity has a direct term, or the displacement of a
                port with a spring.
        """
        model = self.unloaded().state_space
        if not self.baseline_damping:
            return model
        return add_port_damping(model, {port: -c for port, c in self.baseline_damping.items()})

    def unloaded(self) -> IdentifiedVehicle:
        """Return the vehicle about the state without loads; the identified one is about the mean loads of its tests.

        Raises:
            ParameterError: The model is discrete, or the displacement of a port with a spring has a direct term.
        """
        softer = {p: -2.0 * law.spring * law.mean_travel for p, law in self.friction.items() if law.mean_travel}
        if not softer:
            return self
        laws = {port: law._replace(mean_travel=0.0) for port, law in self.friction.items()}
        model = add_port_stiffness(self.state_space, softer)
        return replace(self, state_space=model, friction=laws, validity=None)

    def with_damper(self) -> StateSpace:
        """Return the identified model, with its baseline damping."""
        return self.state_space

    def instability(self) -> str | None:
        """Return which motion of the continuous model grows too fast to be simulated; None if none does."""
        tried = [("without dampers", self.coupled(), GROWTH_WITHOUT)]
        if self.baseline_damping:
            tried.insert(0, ("with its baseline dampers", self.state_space, GROWTH_WITH_DAMPERS))
        for dampers, model, largest in tried:
            poles = model.poles()
            growth = float(poles.real.max(initial=0.0))
            if growth > largest:
                frequency = float(np.abs(poles[np.argmax(poles.real)].imag) / (2.0 * np.pi))
                return f"{dampers}, a motion of {frequency:.3g} Hz grows at a rate of {growth:.3g} 1/s"
        return None


Vehicle = StructuralVehicle | IdentifiedVehicle


# ==== Vehicle files ==================================================================================================


def read_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle: parameters from a .toml file, an identified model from a .json file.

    >>> read_vehicle(shipped("seven_dof")).model
    'seven_dof'

    Raises:
        FileFormatError: The file does not exist, does not have the format of its suffix, has an unsupported schema, or
            an entry is unknown, missing or wrong.
        ParameterError: A value is outside its range, or the model is not consistent.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        return _read_toml(path)
    if path.suffix.lower() == ".json":
        return _read_json(path)
    raise FileFormatError("a vehicle is a .toml file (parameters) or a .json file (identified model)", path=path)


def write_vehicle(path: str | Path, vehicle: Vehicle) -> None:
    """Write a vehicle; an existing file is replaced only when the new one is complete.

    Numbers that are read back are bitwise equal.

    Raises:
        FileFormatError: The suffix does not match the vehicle: .toml for parameters, .json for an identified model.
    """
    needed = ".toml" if isinstance(vehicle, StructuralVehicle) else ".json"
    if Path(path).suffix.lower() != needed:
        raise FileFormatError(f"the vehicle {vehicle.name!r} ({vehicle.model}) must be written as {needed}", path=path)
    text = _toml(vehicle) if isinstance(vehicle, StructuralVehicle) else _rows_on_lines(document(vehicle))
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def shipped(model: Literal["quarter_car", "seven_dof"]) -> Path:
    """Return the path of the file with the dissertation's Table 4.1 (quarter car) or Table 5.1 (seven-DOF car)."""
    return Path(__file__).with_name(f"{model}.toml")


# ---- Parameters in TOML ---------------------------------------------------------------------------------------------
# Every value is a number with its unit in quotes. A corner parameter has one value for all corners ("2000 lbf/in"), one
# per axle ({ front = "1280 lbf/in", rear = "588 lbf/in" }) or one per corner ({ lf = ..., rf = ..., lr = ..., rr = ...
# }). A mass may be given as a weight: sprung_weight = "675 lbf".

#: Newest schema of these files that can be read.
TOML_SCHEMA = 1

_MODELS: dict[str, type[QuarterCar] | type[SevenDof]] = {"quarter_car": QuarterCar, "seven_dof": SevenDof}
_AXLES = {"front": ("lf", "rf"), "rear": ("lr", "rr")}
#: Static values of each model: key of [static], unit and places.
_STATIC: dict[str, dict[str, tuple[str, tuple[str, ...]]]] = {
    "quarter_car": {"tire_force": ("N", ("",)), "ride_height": ("m", ("",))},
    "seven_dof": {"tire_force": ("N", CORNERS), "ride_height": ("m", ("front", "rear"))},
}


def _read_toml(path: Path) -> StructuralVehicle:
    text = read_text(path)
    stated = parse_toml(text, path)
    model: Any = stated.get("model")
    if model not in (*_MODELS,):
        is_other = bool(stated.keys() & {"bank", "components"})
        found = "the file defines a study or a system, not a vehicle" if is_other else f"model is {model!r}"
        raise FileFormatError(f"{found}; a vehicle file has model = {' or '.join(map(repr, _MODELS))}", path=path)
    content = parse_model(_entries(model), text, path, TOML_SCHEMA)
    values = content["parameters"]
    for name in (declared.name for declared in fields(_MODELS[model]) if declared.name.endswith("mass")):
        weight = values.pop(_weight(name), None)
        if (weight is None) == (name not in values):
            raise FileFormatError(f"[parameters] must have {name} or {_weight(name)}, one of them", path=path)
        values.setdefault(name, weight)
    static = {f"{place}.{key}" if place else key: number for key, value in content.get("static", {}).items()
              for place, number in (value if isinstance(value, dict) else {"": value}).items()}  # fmt: skip
    values: dict[str, Any] = {n: Corners(**v) if isinstance(v, dict) else v for n, v in values.items()}
    try:
        return StructuralVehicle(content.get("name", path.stem), _MODELS[model](**values), static)
    except ParameterError as error:
        raise ParameterError(f"{path}, [parameters]: {error}") from error


def _weight(name: str) -> str:
    return name.removesuffix("mass") + "weight"


@cache
def _entries(model: str) -> Any:
    """Return the type of the content of a file with a model's parameters."""
    parameters: dict[str, Any] = {}
    for declared in fields(_MODELS[model]):
        name, places = declared.name, CORNERS if declared.type in (Corners, "Corners") else ("",)
        number = _number(Annotated[float, in_unit(declared.metadata["unit"])], places)
        is_mass = name.endswith("mass")
        parameters[name] = NotRequired[number] if is_mass or declared.default is not MISSING else number
        if is_mass:
            as_weight = Annotated[float, in_unit("N"), AfterValidator(lambda force: force / g)]
            parameters[_weight(name)] = NotRequired[_number(as_weight, places)]
    static = {key: _number(Annotated[float, in_unit(unit)], places) for key, (unit, places) in _STATIC[model].items()}
    known = {"schema": int, "model": str, "parameters": object_of(parameters)}
    optional = {"name": str, "notes": Any, "tool": str, "static": object_of(static, total=False)}
    return object_of(known | {name: NotRequired[kind] for name, kind in optional.items()})


def _number(kind: Any, places: tuple[str, ...]) -> Any:
    """Return the type of a number, or of one for all places or a table of one per axle or place: numbers by place."""
    if places == ("",):
        return kind
    groups = {"": places, **(_AXLES if places == CORNERS else {}), **{place: (place,) for place in places}}

    def spread(numbers: Mapping[str, float]) -> dict[str, float]:
        found = [(place, number) for group, number in numbers.items() for place in groups[group]]
        if sorted(place for place, _ in found) != sorted(places):
            axles = " or of front and rear" if places == CORNERS else ""
            advice = f"must be one value for all, or one for each of {', '.join(places)}{axles}"
            raise PydanticCustomError("value", advice)  # type: ignore[arg-type]
        return dict(found)

    table = object_of(dict.fromkeys(groups, kind), total=False)
    of_all = BeforeValidator(lambda value: value if isinstance(value, dict) else {"": value})
    return Annotated[table, of_all, AfterValidator(spread)]


def _toml(vehicle: StructuralVehicle) -> str:
    """Return the text of a file with a vehicle's parameters in SI."""
    p = vehicle.parameters
    lines = [
        f"schema = {TOML_SCHEMA}",
        f"tool = {_quoted(f'eightpost {eightpost.__version__}')}",
        f"model = {_quoted(vehicle.model)}",
        f"name = {_quoted(vehicle.name)}",
        "",
        "[parameters]",
    ]
    for declared in fields(p):
        value, unit = getattr(p, declared.name), declared.metadata["unit"]
        if value is not None:
            places = value._asdict() if isinstance(value, Corners) else {"": float(value)}
            lines.append(f"{declared.name} = {_written(places, unit)}")
    lines += ["", "[static]"] if vehicle.static else []
    for key, (unit, names) in _STATIC[vehicle.model].items() if vehicle.static else ():
        places = {name: vehicle.static.get(f"{name}.{key}" if name else key, 0.0) for name in names}
        lines.append(f"{key} = {_written(places, unit)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _written(values: Mapping[str, float], unit: str) -> str:
    """Return values by place, or the only one, with their unit."""
    if "" in values:
        return f'"{values[""]!r} {unit}"'
    return "{ " + ", ".join(f'{place} = "{value!r} {unit}"' for place, value in values.items()) + " }"


# ---- JSON files of identified vehicles ------------------------------------------------------------------------------

#: Newest schema of these files that can be read: 2 has bristles and port springs, 3 their mean travel. A file has the
#: oldest schema that is sufficient.
SCHEMA = 3


class _Document(TypedDict):
    """Entries of a vehicle file."""

    schema: int
    kind: NotRequired[str]
    tool: NotRequired[str]
    model: NotRequired[Literal["state_space"]]
    name: str
    sources: NotRequired[dict[str, str]]
    dt: NotRequired[float | None]
    model_name: NotRequired[str]
    inputs: list[Channel]
    outputs: list[Channel]
    baseline_damping: NotRequired[dict[str, float]]
    static: NotRequired[dict[str, float]]
    friction: NotRequired[dict[str, Friction]]
    validity: NotRequired[dict[str, Any]]
    A: list[list[float]]
    B: list[list[float]]
    C: list[list[float]]
    D: list[list[float]]


def document(vehicle: IdentifiedVehicle) -> dict[str, Any]:
    """Return the content of a vehicle file: texts, numbers, lists and tables."""
    model = vehicle.state_space
    friction = {
        port: {"force": law.force, "velocity": law.velocity}
        | ({"bristle": asdict(law.bristle), "spring": law.spring} if _schema(law) > 1 else {})
        | ({"mean_travel": law.mean_travel} if law.mean_travel else {})
        for port, law in vehicle.friction.items()
    }
    return {
        "schema": max((_schema(law) for law in vehicle.friction.values()), default=1),
        "kind": "vehicle",
        "tool": f"eightpost {eightpost.__version__}",
        "model": vehicle.model,
        "name": vehicle.name,
        "sources": dict(vehicle.sources),
        "dt": model.dt,
        "model_name": model.name,
        "inputs": [asdict(channel) for channel in model.inputs],
        "outputs": [asdict(channel) for channel in model.outputs],
        "baseline_damping": dict(vehicle.baseline_damping),
        "static": dict(vehicle.static),
        **({"friction": friction} if friction else {}),
        **({} if vehicle.validity is None else {"validity": vehicle.validity.to_json()}),
        **{field: getattr(model, field).tolist() for field in ("A", "B", "C", "D")},
    }


def _schema(law: Friction) -> int:
    """Return the oldest schema that has all of a law."""
    return 3 if law.mean_travel else 2 if law[2:] != Friction()[2:] else 1


def _rows_on_lines(content: dict[str, Any]) -> str:
    """Return JSON with one matrix row or channel per line, which makes files easy to compare."""
    entries = []
    for key, value in content.items():
        if isinstance(value, list) and value:
            rows = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in value)
            entries.append(f"  {json.dumps(key)}: [\n{rows}\n  ]")
        else:
            entries.append(f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _read_json(path: Path) -> IdentifiedVehicle:
    advice = "eightpost identify makes vehicles"
    content = document_of(_Document, json_content(path), path, "vehicle", SCHEMA, advice)
    try:
        return _vehicle(content, path.name)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


def _vehicle(content: _Document, origin: str) -> IdentifiedVehicle:
    inputs, outputs, name = tuple(content["inputs"]), tuple(content["outputs"]), content["name"]
    n, m, p = len(content["A"]), len(inputs), len(outputs)

    def matrix(key: Literal["A", "B", "C", "D"], *shape: int) -> Array:
        """Return a matrix; one without states is an empty list."""
        rows = content[key]
        if len({len(row) for row in rows}) > 1:
            raise ParameterError(f"{key}: its rows must have one length; identify the vehicle again")
        return np.array(rows) if any(rows) or 0 not in shape else np.zeros(shape)

    A, B, C, D = matrix("A", n, n), matrix("B", n, m), matrix("C", p, n), matrix("D", p, m)
    model = StateSpace(A, B, C, D, inputs, outputs, content.get("dt"), content.get("model_name", name))
    vehicle = IdentifiedVehicle(
        name,
        model,
        content.get("baseline_damping", {}),
        content.get("static", {}),
        content.get("sources", {}),
        content.get("friction", {}),
    )
    if "validity" not in content:
        return vehicle
    return replace(vehicle, validity=Validity.from_json(content["validity"]).checked(vehicle.numbers, origin))
