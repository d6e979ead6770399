"""A verdict is about certain numbers: a file that was edited afterwards is "unknown" (docs/reference/verdict.md)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf, nextafter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.io import loadmat

from builder.build import product_of
from builder.native_fmu import without_binaries
from builder.reference import Disclosure, combined_member, validity_member
from eightpost.errors import InputError
from eightpost.ident.dyno_report.entry import entry_of_shock
from eightpost.ident.dyno_report.page import report_verdict
from eightpost.ident.export import export
from eightpost.ident.shock_table import shock_table
from eightpost.ident.validation.shocks import ShockValidation, shock_verdict
from eightpost.shock import Port, Shock, read_shock, write_shock
from eightpost.shock.file import fitted_parameters
from eightpost.validity import MEMBER, Range, Validity, judged
from eightpost.vehicle import Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped, write_vehicle
from eightpost.vehicle.friction import Bristle
from eightpost.verdict import Grade, Reason, Verdict, digest_of, edits_in

SHIPPED = Path(__file__).parents[1] / "examples"
FITTED, CAR = SHIPPED / "hosts" / "shock.json", Path("identified") / "car.json"
EDITED = "edited after it was judged"

#: A place in a JSON document: keys and indices.
Place = tuple[Any, ...]


def leaves(value: Any, at: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield each text and number of a document with its place."""
    if isinstance(value, (dict, list)):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(one, (*at, key))
    else:
        yield at, value


def value_at(document: Any, at: Place) -> Any:
    for key in at:
        document = document[key]
    return document


def edited(document: Any, at: Place, value: Any) -> Any:
    """Return a copy of a document with another value at a place."""
    found = json.loads(json.dumps(document))
    value_at(found, at[:-1])[at[-1]] = value
    return found


def is_judged(at: Place) -> bool:
    """Return whether the verdict is about what is at a place of a shock file or a vehicle file."""
    if at[0] == "conditions":
        return str(at[1]).endswith("]")
    return at[0] not in ("schema", "tool", "name", "kind", "model_name", "inputs") and (
        at[-1] != "schema"
    )  # fmt: skip


def identified() -> IdentifiedVehicle:
    """Return a quarter car with friction, a bristle, a spring and a static state, judged to be usable."""
    friction = {"": Friction(30.0, 0.01, Bristle(force=20.0), spring=200.0)}
    ranges = (Range("velocity", "frequency", 0.1, 16.0, "Hz"), Range("displacement", "amplitude", -0.02, 0.03, "m"))
    reason = Reason("r", "fit of the vehicle", Grade.USABLE, "s", "misfit 2 %", "run.csv", "nothing")
    damping = {"": 1500.0}
    whole = read_vehicle(shipped("quarter_car")).coupled()
    model = add_port_damping(whole, damping).select(outputs=["velocity", "displacement", "tire_force"])
    car = IdentifiedVehicle("car", model, damping, {"tire_force": 3000.0}, {"run.csv": "0" * 64}, friction)
    return judged(car, validity=Validity(Verdict([reason]), ranges))


READ: dict[str, Callable[[Path], Shock | IdentifiedVehicle]] = {"shock": read_shock, "car": read_vehicle}  # type: ignore[dict-item]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a fitted shock and an identified car."""
    folder = tmp_path_factory.mktemp("judged")
    write_shock(read_shock(FITTED), folder / "shock.json")
    write_vehicle(folder / "car.json", identified())
    return folder


@pytest.fixture(scope="module")
def files(folder: Path) -> dict[str, Any]:
    """Content of the files of a fitted shock and of an identified car."""
    return {kind: json.loads((folder / f"{kind}.json").read_text(encoding="utf-8")) for kind in READ}


@pytest.fixture(scope="module")
def read(folder: Path) -> Callable[[str, Any], Shock | IdentifiedVehicle]:
    """Write a document as `edited.json`, or a text as it is, and read it."""

    def call(kind: str, content: Any) -> Shock | IdentifiedVehicle:
        path = folder / "edited.json"
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return READ[kind](path)

    return call


def rules(model: Shock | IdentifiedVehicle) -> list[str]:
    assert model.validity is not None
    return [reason.rule for reason in model.validity.verdict.reasons]


def is_usable(model: Shock | IdentifiedVehicle) -> bool:
    return model.validity is not None and model.validity.verdict.grade is Grade.USABLE


# ---- Files ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", READ)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_judged_number_that_is_changed_makes_the_verdict_unknown(kind, files, read, data) -> None:
    """The smallest change and large ones; a value that is impossible is refused, as ever."""
    numbers = [at for at, value in leaves(files[kind]) if type(value) in (int, float) and is_judged(at)]
    assert len(numbers) > 60
    at = data.draw(st.sampled_from(numbers))
    old = value_at(files[kind], at)
    new = data.draw(st.sampled_from([nextafter(old, inf), nextafter(old, -inf), 3.0 * old, -1e9 * old, old + 1.0]))
    assume(new != old)
    try:
        model = read(kind, edited(files[kind], at, new))
    except InputError:
        assume(False)
    assert rules(model) == [EDITED], (at, old, new)
    assert model.validity.verdict.grade is Grade.UNKNOWN
    assert not model.validity.ranges
    assert model.validity.verdict.reasons[0].origin == "edited.json"


@pytest.mark.parametrize("kind", READ)
def test_a_verdict_or_its_figure_that_is_changed_alone_is_unknown(kind, files, read) -> None:
    reason = ("validity", "verdict", "reasons", 0)
    changes = {
        (*reason, "figure"): "residual 0.1 %",
        (*reason, "grade"): "usable within limits",
        (*reason, "origin"): "another.csv",
        ("validity", "verdict", "reasons"): [],
        ("validity", "ranges"): [],
        ("validity", "verdict", "grade"): "not usable",
        ("validity", "judged"): "0" * 64,
    }
    for at, value in changes.items():
        assert rules(read(kind, edited(files[kind], at, value))) == [EDITED], at
    assert is_usable(read(kind, edited(files[kind], ("validity", "verdict", "summary"), "Good.")))  # from the reasons


@pytest.mark.parametrize("kind", READ)
def test_form_names_and_comments_are_not_judged(kind, files, read) -> None:
    document = files[kind]
    backwards = json.loads(json.dumps(document), object_pairs_hook=lambda pairs: dict(reversed(pairs)))
    assert is_usable(read(kind, json.dumps(backwards, indent=7, separators=(" , ", " :\t"))))
    whole = {at: int(value) for at, value in leaves(document) if type(value) is float and value == int(value)}
    assert whole
    text = document
    for at, value in whole.items():  # as other programs write 3000.0 and -0.0
        text = edited(text, at, value)
    assert is_usable(read(kind, text))
    for name, value in (("name", "renamed"), ("tool", "eightpost 99.0.0")):
        assert is_usable(read(kind, edited(document, (name,), value)))


def test_notes_in_the_conditions_of_a_shock_are_not_judged_but_its_quantities_are(files, read) -> None:
    document = files["shock"]
    for note in ({"clicks": "rebound 12"}, {"driver": "Ann", "heat": 3}):
        assert is_usable(read("shock", document | {"conditions": document["conditions"] | note}))
    colder = document["conditions"] | {"temperature_range [K]": [270.0, 280.0]}
    assert rules(read("shock", document | {"conditions": colder})) == [EDITED]


def test_the_records_of_a_fit_may_be_renamed_but_not_exchanged(files, read) -> None:
    (entry,) = files["shock"]["inputs"]
    assert is_usable(read("shock", files["shock"] | {"inputs": [entry | {"name": "moved.csv"}]}))
    assert rules(read("shock", files["shock"] | {"inputs": [entry | {"sha256": "0" * 64}]})) == [EDITED]
    assert is_usable(read("car", files["car"] | {"sources": {"moved.csv": "0" * 64}}))
    assert rules(read("car", files["car"] | {"sources": {}})) == [EDITED]


@pytest.mark.parametrize("kind", READ)
def test_a_file_of_a_version_without_digests_keeps_its_verdict(kind, files, read) -> None:
    document = json.loads(json.dumps(files[kind]))
    del document["validity"]["judged"]
    model = read(kind, document)
    assert is_usable(model)
    assert model.validity.judged is None


def test_a_value_that_is_its_default_may_be_left_out(files, read) -> None:
    """A later version with a further value, at its default in old files, finds the same digest."""
    document = json.loads(json.dumps(files["shock"]))
    assert document["port"].pop("motion_ratio") == 1.0
    assert is_usable(read("shock", document))


@pytest.mark.parametrize("kind", READ)
def test_reading_and_writing_keeps_what_was_judged_and_what_was_edited(kind, files, read, folder: Path) -> None:
    write = write_shock if kind == "shock" else lambda model, path: write_vehicle(path, model)
    write(READ[kind](folder / f"{kind}.json"), folder / f"again_{kind}.json")
    assert (folder / f"again_{kind}.json").read_bytes() == (folder / f"{kind}.json").read_bytes()
    place = ("curve", "inner", 1) if kind == "shock" else ("C", 0, 0)
    changed = read(kind, edited(files[kind], place, 17.5))
    write(changed, folder / f"edited_{kind}.json")
    once_more = READ[kind](folder / f"edited_{kind}.json")
    assert rules(once_more) == [EDITED]
    assert once_more.validity == changed.validity  # the first file in which it was found


@pytest.mark.parametrize(
    "path",
    [*SHIPPED.glob("hosts/shock*.json"), *SHIPPED.glob("bank/*.json"), SHIPPED / CAR],
    ids=lambda path: path.stem,
)
def test_shipped_models_are_as_they_were_judged(path: Path) -> None:
    validity = (read_vehicle if path.name == "car.json" else read_shock)(path).validity
    assert validity.judged is not None
    assert not validity.edits


# ---- Python ---------------------------------------------------------------------------------------------------------


def test_a_shock_that_is_changed_in_python_has_no_verdict_and_no_fit(folder: Path) -> None:
    shock = read_shock(folder / "shock.json")
    assert fitted_parameters(shock) is not None
    assert is_usable(replace(shock, name="other", conditions={**shock.conditions, "note": "x"}))
    stiffer = replace(shock, law=replace(shock.law, port=Port(gas_stiffness=500.0)))
    assert rules(stiffer) == [EDITED]
    assert stiffer.validity.verdict.reasons[0].origin == shock.name
    assert fitted_parameters(stiffer) is None
    write_shock(stiffer, folder / "stiffer.json")
    assert rules(read_shock(folder / "stiffer.json")) == [EDITED]


def test_a_car_that_is_changed_in_python_has_no_verdict() -> None:
    car = identified()
    assert is_usable(replace(car, name="other"))
    assert rules(replace(car, static={"tire_force": 3001.0})) == [EDITED]
    softer = replace(car, friction={"": car.friction[""]._replace(spring=100.0)})
    assert rules(softer) == [EDITED]


def test_code_that_judges_ties_the_verdict_to_the_changed_numbers() -> None:
    car = identified()
    changed = judged(car, static={"tire_force": 3001.0})
    assert changed.validity.verdict == car.validity.verdict
    assert changed.validity.judged != car.validity.judged
    assert judged(replace(car, validity=None)).validity is None


def test_a_validation_of_an_edited_shock_is_added_to_what_is_unknown() -> None:
    shock = read_shock(FITTED)
    edited_one = replace(shock, law=replace(shock.law, port=Port(gas_stiffness=500.0)))
    good = Verdict([Reason("r", "validation of the shock", Grade.USABLE, "s", "1 %", "b.csv", "nothing")])
    validated = judged(edited_one, validity=Validity.with_verdict(edited_one.validity, good))
    assert rules(validated) == [EDITED, "r"]
    assert validated.validity.verdict.grade is Grade.UNKNOWN
    again = replace(validated, law=shock.law)
    assert rules(again) == [EDITED]  # the validation was of other numbers too


def test_a_validation_and_a_report_of_an_edited_shock_say_that_it_is_unknown(files, read) -> None:
    intact = read_shock(FITTED)
    changed = read("shock", edited(files["shock"], ("port", "gas_preload"), 300.0))
    validation = shock_verdict(ShockValidation({"a": intact, "b": changed}, (), (), ()))
    report = report_verdict([entry_of_shock(shock, shock.name, "") for shock in (intact, changed)])
    for verdict in (validation, report):
        assert len(edits_in(verdict)) == 1
        assert verdict.grade is Grade.UNKNOWN
        assert "edited after the fit or run: its numbers are not those that were judged" in verdict.summary()
    assert edits_in(validation)[0].origin == "edited.json"
    assert not edits_in(shock_verdict(ShockValidation({"a": intact}, (), (), ())))


def test_an_exported_car_keeps_its_verdict_although_its_inputs_have_another_meaning(folder: Path) -> None:
    export(folder / "car.json", folder / "car.mat", ports="whole")
    content = loadmat(folder / "car.mat")
    matrices = {name: content[name].tolist() for name in "ABCD"}
    document = json.loads(str(content["eightpost"][0])) | matrices
    (folder / "exported.json").write_text(json.dumps(document), encoding="utf-8")
    exported = read_vehicle(folder / "exported.json")
    assert is_usable(exported)
    assert exported.validity.judged not in (None, identified().validity.judged)


def test_a_table_of_an_edited_shock_says_that_it_is_unknown(files, read, folder: Path) -> None:
    said = "unknown: edited after the fit or run"
    read("shock", edited(files["shock"], ("curve", "inner", 1), 1.1 * files["shock"]["curve"]["inner"][1]))
    assert any(remark.startswith(said) for remark in shock_table([folder / "edited.json"]).remarks)
    assert not any(said in remark for remark in shock_table([folder / "shock.json"]).remarks)


# ---- FMUs -----------------------------------------------------------------------------------------------------------


def test_an_fmu_of_an_intact_file_has_its_verdict_without_a_digest_and_its_page_mentions_no_edit(folder: Path) -> None:
    (content,) = validity_member(identified(), "car", Disclosure.FULL).values()
    assert Validity.from_json(json.loads(content)) == replace(identified().validity, judged=None)
    (content,) = validity_member(read_shock(FITTED), "shock", Disclosure.FULL).values()
    stated = Validity.from_json(json.loads(content))
    assert (stated.verdict.grade, stated.judged) == (Grade.USABLE, None)
    members = without_binaries(product_of(folder / "shock.json"), Disclosure.FULL).members
    assert b"edited after" not in members["documentation/index.html"]


@pytest.mark.parametrize(
    ("kind", "place", "factor", "disclosure"),
    [
        ("shock", ("curve", "inner", 1), -1e9, Disclosure.FULL),
        ("car", ("C", 2, 1), 3.0, Disclosure.CONFIDENTIAL),
    ],
    ids=str,
)
def test_an_fmu_of_an_edited_file_says_that_it_is_unknown(kind, place, factor, disclosure, files, read, folder) -> None:
    """The case that was found: a coefficient times -1e9 was built and stayed usable."""
    read(kind, edited(files[kind], place, factor * value_at(files[kind], place)))
    members = without_binaries(product_of(folder / "edited.json"), disclosure).members
    stated = Validity.from_json(json.loads(members[MEMBER]))
    assert [reason.rule for reason in stated.verdict.reasons] == [EDITED]
    assert stated.uncertainty is None
    assert b"Unknown: edited after the fit or run" in members["documentation/index.html"]
    assert disclosure is Disclosure.FULL or b"edited.json" not in b"".join(members.values())
    (content,) = combined_member({"part": members[MEMBER]}, {}, frozenset()).values()
    assert Validity.from_json(json.loads(content)).edits


# ---- The digest -----------------------------------------------------------------------------------------------------


def test_the_digest_is_that_of_a_canonical_text() -> None:
    """SHA-256 of {"a":[1.0,true,null],"b":0.1}, from another program."""
    known = "896186a882e060e4e13a9b42b6a000efce9e5f46c935e3a599e27aaf6e919633"
    assert digest_of({"b": 0.1, "a": (1, True, None)}) == known
    assert digest_of({"a": [1.0, True, None], "b": 0.1}) == known
    assert digest_of([0.0]) == digest_of([-0.0]) == digest_of([0])
    assert (
        len({digest_of(one) for one in ([1, 2], [2, 1], [[1], 2], ["1", 2], [True, 2], [1.0000000000000002, 2])}) == 6
    )
