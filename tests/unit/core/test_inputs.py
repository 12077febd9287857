"""Inputs declared once: one range, whatever hands the value in, and the name that source uses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Gt, Le

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import Input, Inputs, Source, build_inputs
from benchtool.core.toml_text import read_strict

Positive = Annotated[float, Gt(0.0), Le(100.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Throttle(Inputs):
    pwm_us: Annotated[tuple[Positive, ...], Input("Levels.", "us", option="pwm")] = ()
    ramp_s: Annotated[float, Ge(0.0), Le(10.0), Input("Time between levels.", "s")] = 0.3
    ratio: Annotated[tuple[Positive, ...], Input("The same.", instead_of="pwm_us")] = ()
    inner: Positive = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Order(Inputs):
    device: Annotated[str, Input("Which device.", argument="DEVICE")]
    repeats: Annotated[Annotated[int, Ge(1)] | None, Input("Visits.", label="Repeats")] = None
    kind: Annotated[Literal["random", "given"], Input("Order.", option="order")] = "random"
    offset_m: Annotated[tuple[float, float], Input("X,Y.", "m")] = (0.0, 0.0)
    only: Annotated[tuple[str, ...], Input("Names.")] = ()
    names: Annotated[tuple[str, ...], Input("Names.", comma_separated=True)] = ()
    set: Annotated[Mapping[str, float], Input("NAME=VALUE.")] = field(default_factory=dict)
    out: Annotated[Path | None, Input("Folder.")] = None
    quick: Annotated[bool, Input("Be quick.")] = False
    throttle: Throttle = Throttle()


def order(source: Source = "keyword", **given: Any) -> Order:
    return build_inputs(Order, {"device": "sim", **given}, source=source)


by_option, by_label = partial(order, "option"), partial(order, "label")


def by_file(**given: Any) -> Order:
    ((name, value),) = given.items()
    return read_strict(Order, f'device = "sim"\n[throttle]\n{name} = {value}\n', "plan.toml")


@pytest.mark.parametrize(
    ("source", "called"),
    [
        (by_option, "--ramp-s is -3 s, allowed is 0 to 10 s; correct it"),
        (by_label, "Time between levels, s is -3 s, allowed is 0 to 10 s; correct it"),
        (order, "ramp_s is -3 s, allowed is 0 to 10 s; correct it"),
        (Throttle, "ramp_s is -3 s, allowed is 0 to 10 s; correct it"),
        (by_file, "plan.toml: throttle.ramp_s is -3.0: input should be greater than or equal to 0"),
    ],
)
def test_a_range_holds_and_is_named_as_the_source_names_it(source, called):
    with pytest.raises(InputError) as refused:
        source(ramp_s=-3.0)
    assert str(refused.value).startswith(called)
    assert source(ramp_s=2.0) is not None


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"pwm": "5,x"}, "--pwm is '5,x'; give numbers separated by commas, for example 0.5,1,2"),
        ({"pwm": ","}, "--pwm is empty; give numbers, for example 0.5,1,2"),
        ({"pwm": "5,0"}, "--pwm names 0 us, allowed is above 0, at most 100 us; correct it (dec"),
        ({"pwm": "nan"}, "--pwm names nan us, allowed is above 0, at most 100 us; correct it"),
        ({"ramp_s": float("nan")}, "--ramp-s is nan s, allowed is 0 to 10 s; correct it"),
        ({"ramp_s": True}, "--ramp-s is True: input should be a valid number; correct it"),
        ({"offset_m": "1,inf"}, "--offset-m names inf m, allowed is a finite number; correct it"),
        ({"offset_m": "1"}, "--offset-m is '1'; give 2 numbers separated by commas"),
        ({"ramp_s": "1kg"}, "--ramp-s is '1kg'; type a number, with a unit of s, ms, us or none"),
        ({"ramp_s": "fast"}, "--ramp-s is 'fast'; type a number"),
        ({"ramp_s": "..s"}, "--ramp-s is '..s'; type a number"),
        ({"ramp_s": "1.2.3ms"}, "--ramp-s is '1.2.3ms'; type a number"),
        ({"ramp_s": "1e999ms"}, "--ramp-s is inf s, allowed is 0 to 10 s; correct it"),
        ({"repeats": "3s"}, "--repeats is '3s'; type a whole number"),
        ({"repeats": "1.5"}, "--repeats is '1.5'; type a whole number"),
        ({"repeats": 0}, "--repeats is 0, allowed is 1 or more; correct it"),
        ({"order": "givn"}, "unknown --order 'givn'; did you mean 'given'? known: given, random"),
        ({"set": ["K_b"]}, "--set got 'K_b'; write NAME=NUMBER, as K_b=1.8"),
        ({"set": ["K_b=nan"]}, "--set got 'K_b=nan'; write NAME=NUMBER, as K_b=1.8"),
        ({"pwm": "5", "ratio": "1"}, "--pwm and --ratio are both given; give one of them"),
        ({"ramp": 1}, "unknown input 'ramp'; did you mean 'ramp_s'?"),
        ({"device": None}, "DEVICE is missing; give it"),
    ],
)
def test_what_is_refused_says_why(given, sentence):
    with pytest.raises(InputError) as refused:
        by_option(**given)
    assert str(refused.value).startswith(sentence)


@pytest.mark.parametrize("text", ["0.3", "300ms", "300 ms", "0.3s", "3e5us", "+.3 s"])
def test_a_typed_number_may_carry_a_unit_of_its_dimension(text):
    assert order(ramp_s=text).throttle.ramp_s == pytest.approx(0.3, rel=1e-12)
    assert order(offset_m="5cm, -1in").offset_m == pytest.approx((0.05, -0.0254))


def test_what_is_given_goes_over_the_base_and_no_default_does():
    base = order(pwm=[5.0], ramp_s=2.0, order="given")
    after = build_inputs(Order, {"ratio": "1,2"}, base=base)
    assert (after.kind, after.throttle.ramp_s) == ("given", 2.0)
    assert (after.throttle.pwm_us, after.throttle.ratio) == ((), (1.0, 2.0))
    with pytest.raises(UnknownChoice):  # a part's own field that is no input
        build_inputs(Order, {"inner": 3.0}, base=base)
    with pytest.raises(InputError, match="inner is 500, allowed is"):
        Throttle(inner=500.0)
    with pytest.raises(InputError, match=r"throttle is 3; make it with Throttle"):
        Order(device="sim", throttle=3)  # type: ignore[arg-type]
