"""Any shock law as a PythonFMU slave with the port of docs/reference/ports.md.

The builder copies this file to <model>_<digest>.py next to the package <model>_<digest>_law, which contains the same
law files that the library uses for fits. Absolute names would make two FMUs in one process share code.
"""

from importlib import import_module

from pythonfmu.enums import Fmi2Status

TableSlave = import_module(f"{__name__}_law.table_slave").TableSlave
StaticCurve = import_module(f"{__name__}_law.curve").StaticCurve
Port = import_module(f"{__name__}_law.law").Port

_OUTPUTS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")


class ShockSlave(TableSlave):
    """Slave that steps a law with its inputs held; the law's states are themselves variables."""

    def __init__(self, **kwargs):
        super().__init__(f"{__name__}.json", **kwargs)
        module = import_module(f"{__name__}_law.{self.model['law']}")
        self.law_class = getattr(module, self.model["class"])
        self.states = getattr(module, "STATES", ("lagged_force",))
        self.sizes = getattr(module, "SIZES", {})
        self.settings = self._settings(self.model["settings"]) if "settings" in self.model else None
        self.own_parameters = [name for name in self.law_class.__dataclass_fields__ if name not in ("curve", "port")]

    def refresh(self):
        self.law = self.law_class(
            curve=StaticCurve(**self._group("curve", StaticCurve)),
            port=Port(**{name: self.values[name] for name in Port.__slots__}),
            **{name: self._own(name) for name in self.own_parameters},
        )
        if self.settings is not None:
            self._set_law()
        if self.values["motion_ratio"] > 1.5:
            self.log(
                f"motion_ratio = {self.values['motion_ratio']!r} is above 1.5: is it port travel per damper travel?",
                Fmi2Status.warning,
                "logStatusWarning",
            )

    def initialise(self):
        self._respond(self.law.start(self.values["velocity"]))

    def advance(self, step):
        if self.settings is not None and self._setting() != self.setting:  # the temperature may be an input
            self.refresh()
        velocity, states = self.values["velocity"], [self.values[name] for name in self.states]
        state = states[0] if len(states) == 1 else tuple(states)
        self._respond(self.law.follow(state, velocity, velocity, step))

    def _settings(self, table):
        module = import_module(f"{__name__}_law.settings")
        rows = {name: tuple(tuple(row) for row in table[name]) for name in ("tested", "half_width")}
        axes = tuple(module.Axis(**axis | {"nodes": tuple(axis["nodes"])}) for axis in table["axes"])
        terms = tuple(
            module.Term(tuple(term["axes"]), tuple(tuple(row) for row in term["deviations"])) for term in table["terms"]
        )
        self.is_tested = module.is_tested
        return module.Settings(axes=axes, parameters=tuple(table["parameters"]), terms=terms, **rows)

    def _setting(self):
        return tuple(self.values[axis.variable] for axis in self.settings.axes)

    def _set_law(self):
        self.setting = self._setting()
        self.law = self.settings.law_at(self.law, self.setting)
        self.values["beyond_settings"] = max(
            axis.intervals_beyond(value) for axis, value in zip(self.settings.axes, self.setting, strict=True)
        )
        self.values["untested_settings"] = 0.0 if self.is_tested(self.settings, self.setting) else 1.0

    def _respond(self, state):
        response = self.law.response(state, self.values["velocity"], self.values["displacement"])
        self.values.update(zip(self.states, [state] if len(self.states) == 1 else state, strict=True))
        for name in _OUTPUTS:
            self.values[name] = getattr(response, name)

    def _own(self, name):
        if name not in self.sizes:
            return self.values[name]
        prefix = name if f"{name}[1]" in self.values else f"curve.{name}"
        return tuple(self.values[f"{prefix}[{k + 1}]"] for k in range(self.sizes[name]))

    def _group(self, prefix, kind):
        sizes = {name: sum(key.startswith(f"{prefix}.{name}[") for key in self.values) for name in kind.__slots__}
        return {
            name: tuple(self.values[f"{prefix}.{name}[{k}]"] for k in range(1, size + 1))
            if size
            else self.values[f"{prefix}.{name}"]
            for name, size in sizes.items()
        }
