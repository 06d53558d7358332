"""What drives the flow, and the scale of the forces."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.json_schema import Rule, at, equals, every, given, one_of, some, when
from ffsi.scene.samples import Samples, samples_of
from ffsi.scene.units import Count, Duration, FlowRate, Length, Number, Speed, Stress
from ffsi.scene.waveforms import Fourier, named_waveforms, read_waveform

_TIME = ("t",)
PROFILES = {"parabolic": "1.5 * 4 * y * (H - y) / H^2", "uniform": "1"}
WOMERSLEY = "womersley"
VELOCITIES = ("mean_velocity", "peak_velocity", "flow_rate")
PROFILE_KEYS = ("profile", "profile_file", "profile_samples")
WAVEFORMS = ("waveform", "waveform_file", "series")
HARMONICS = 12
MAX_HARMONICS = 100
InflowType = TypeVar("InflowType", bound="Inflow")


class Series(Table):
    """Fourier series of a waveform: sum over k of cosine[k] cos(2 pi k t/period) + sine[k] sin(2 pi k t/period)."""

    model_config = ConfigDict(
        json_schema_extra=every(at(key, {"minItems": 1, "maxItems": MAX_HARMONICS + 1}) for key in ("cosine", "sine"))
    )

    cosine: tuple[Number, ...] = Field(description="coefficients of the cosines, the mean first, dimensionless")
    sine: tuple[Number, ...] = Field(description="coefficients of the sines, 0 for the mean first, dimensionless")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not 1 <= len(self.cosine) <= MAX_HARMONICS + 1:
            refuse([Problem("cosine", f"accepted: 1 to {MAX_HARMONICS + 1} numbers", short(self.cosine))])
        if len(self.sine) != len(self.cosine):
            refuse([Problem("sine", f"accepted: as many numbers as cosine, {len(self.cosine)}", short(self.sine))])
        return self


def _rules(drives: tuple[str, ...]) -> Rule:
    return every(
        [
            one_of([key] for key in drives),
            one_of([[], *([key] for key in WAVEFORMS)]),
            when(given("harmonics"), given("waveform_file")),
            when(given("series"), given("period")),
            when(given("period"), some(*map(given, WAVEFORMS))),
            when(equals("profile", WOMERSLEY), some(*map(given, WAVEFORMS))),
        ]
    )


class Inflow(Table):
    """Velocity at the inlet, normal to it and inwards: mean_velocity * profile(y), in time * ramp(t) * waveform(t).

    y is the distance from the inlet's start (`geometry.inlet`). The ramp is (1 - cos(pi t/ramp))/2 until t = ramp and
    1 from then on. The profile "womersley" is that of an oscillating channel flow with the flow rate of the waveform.

    One of mean_velocity, peak_velocity and flow_rate is given; a `Scene` turns the last two into mean_velocity. A
    waveform_file is turned into series here, so that a scene needs no other file.
    """

    model_config = ConfigDict(json_schema_extra=_rules(VELOCITIES))
    drives: ClassVar[tuple[str, ...]] = VELOCITIES
    """Keys of which exactly one is given."""

    mean_velocity: Speed | None = Field(None, description="mean velocity of the built-in profiles, m/s")
    peak_velocity: Speed | None = Field(None, description="largest velocity over the inlet, m/s")
    flow_rate: FlowRate | None = Field(None, description="flow rate per metre of depth, m^2/s")
    profile: str = Field(
        "parabolic",
        description='"parabolic", "uniform", "womersley" or a dimensionless formula in y (along the inlet) and H (its '
        "length), both in m",
        examples=[*PROFILES, WOMERSLEY],
    )
    profile_file: str | None = Field(
        None,
        description="or a CSV file with the profile, columns y (m, from the inlet's start) and value (dimensionless), "
        "straight lines between; beside the scene's file",
    )
    profile_samples: Samples | None = Field(None, description="the profile of such a file, at y in m, dimensionless")
    ramp: Duration | None = Field(
        None, description="time in which the inflow grows from rest by a cosine (none if absent; needs a table time), s"
    )
    waveform: str | None = Field(
        None,
        description='dimensionless formula in t (s), or "sinus", "aneurysm-84bpm", "mca": a factor on the inflow; '
        'needs a table time; "1" if absent',
    )
    waveform_file: str | None = Field(
        None, description="CSV file with one period of the waveform, columns t (s) and value; beside the scene's file"
    )
    harmonics: Annotated[int, Count(1, MAX_HARMONICS)] | None = Field(
        None, description=f"number of terms of the waveform_file's Fourier series, {HARMONICS} if absent, dimensionless"
    )
    series: Series | None = Field(None, description="the waveform as a Fourier series, dimensionless; needs period")
    period: Duration | None = Field(
        None,
        description="period of the waveform, that of a named waveform or of the file if absent, not less than the "
        "file's times cover, s",
    )

    @field_validator("profile", "waveform")
    @classmethod
    def _readable(cls, text: str | None, info: ValidationInfo) -> str | None:
        known: tuple[str, ...] = (*PROFILES, WOMERSLEY)
        variables: tuple[str, ...] = ("y", "H")
        if info.field_name == "waveform":
            known, variables = tuple(named_waveforms()), _TIME
        try:
            if text is not None and text not in known:
                Expression.parse(text, variables)
        except ExpressionError as error:
            accepted = f"{error}; accepted: {names(known)} or a formula in {' and '.join(variables)}"
            refuse([Problem("", accepted, short(text), nearest(str(text), known))])
        return text

    @model_validator(mode="after")
    def _complete(self) -> Self:
        refuse(list(self._problems()))
        if self.profile_file is not None:
            self.fill(**samples_of(self.profile_file, "profile", "y"))
        if self.waveform_file is not None:
            self.fill(**_series_of_file(self.waveform_file, self.harmonics, self.period))
        elif self.period is None and self.waveform in named_waveforms():
            self.fill(period=named_waveforms()[self.waveform].period)
        if self.profile == WOMERSLEY and self.fourier is None:
            text = f"needs a waveform that is a Fourier series: {names(named_waveforms())} or a waveform_file"
            refuse([Problem("profile", text, short(self.profile))])
        return self

    def _problems(self) -> Iterator[Problem]:
        given = [key for key in self.drives if getattr(self, key) is not None]
        if len(given) != 1:
            text = "missing" if not given else f"{' and '.join(given)} are given"
            described = type(self).model_fields["mean_velocity"].description
            yield Problem("mean_velocity", f"{text}; exactly one of {', '.join(self.drives)} is needed ({described})")
        profiles = [key for key in PROFILE_KEYS[1:] if getattr(self, key) is not None]
        if self.profile != "parabolic":
            profiles = ["profile", *profiles]
        if len(profiles) > 1:
            yield Problem(
                profiles[0], f"{' and '.join(profiles)} are given; accepted: one of {', '.join(PROFILE_KEYS)}"
            )
        waveforms = [key for key in WAVEFORMS if getattr(self, key) is not None]
        if len(waveforms) > 1:
            yield Problem(waveforms[0], f"{' and '.join(waveforms)} are given; accepted: one of {', '.join(WAVEFORMS)}")
        if self.harmonics is not None and self.waveform_file is None:
            yield Problem("harmonics", "only accepted with waveform_file", short(self.harmonics))
        if self.series is not None and self.period is None:
            yield Problem("period", f"missing; {type(self).model_fields['period'].description}")
        if self.period is not None and not waveforms:
            yield Problem("period", "only accepted with a waveform", f"{short(self.period)} s")

    @property
    def expression(self) -> Expression:
        """The profile as a formula in y and H (both in m), dimensionless; of "womersley" that of the mean flow."""
        if self.profile_samples is not None:
            return self.profile_samples.expression("y", "H")
        profile = "parabolic" if self.profile == WOMERSLEY else self.profile
        return Expression.parse(PROFILES.get(profile, profile))

    @property
    def fourier(self) -> Fourier | None:
        """The waveform as a Fourier series, dimensionless; None if it is a formula or none is given."""
        if self.period is None:
            return None
        if self.series is not None:
            return Fourier(self.period, self.series.cosine, self.series.sine)
        named = named_waveforms().get(self.waveform or "")
        return named and Fourier(self.period, named.cosine, named.sine)

    @property
    def waveform_expression(self) -> Expression:
        """The waveform as a formula in t (s), dimensionless; "1" if none is given. The ramp is no part of it.

        Raises:
            ExpressionError: the waveform is a Fourier series, see `fourier`.
        """
        if self.fourier is not None:
            raise ExpressionError("the waveform is a Fourier series, no formula")
        return Expression.parse("1" if self.waveform is None else self.waveform, _TIME)

    def ramp_factor(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the ramp at the times t (s, from 0), dimensionless: 1 everywhere without one."""
        times = np.asarray(t, dtype=np.float64)
        if self.ramp is None:
            return np.ones_like(times)
        return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.clip(times / self.ramp, 0.0, 1.0))))

    def factor(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return ramp times waveform at the times t (s, from 0), dimensionless."""
        return np.asarray(self.ramp_factor(t) * self.waveform_factor(t))

    def waveform_factor(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the waveform alone at the times t (s, from 0), dimensionless."""
        times = np.asarray(t, dtype=np.float64)
        series = self.fourier
        return series(times) if series else self.waveform_expression.evaluate(t=times)


class Inlet(Inflow):
    """One of several inlets: a velocity as in the table `inflow`, or a pressure behind it.

    The pressure is the mean normal traction, -p n + mu (grad v) n = -pressure n, in time * ramp(t) * waveform(t).
    """

    model_config = ConfigDict(
        json_schema_extra=every([_rules((*VELOCITIES, "pressure")), {"not": equals("profile", WOMERSLEY)}])
    )
    drives: ClassVar[tuple[str, ...]] = (*VELOCITIES, "pressure")

    pressure: Stress | None = Field(None, description="mean normal traction, instead of a velocity, Pa")
    direction: Literal["free", "normal"] = Field(
        "free", description='of the flow at a pressure inlet: "free", or "normal" to it, which is along x or y then'
    )

    def _problems(self) -> Iterator[Problem]:
        yield from super()._problems()
        if self.profile == WOMERSLEY:
            yield Problem("profile", "only accepted in the table inflow", short(self.profile))
        if self.pressure is not None and (self.profile != "parabolic" or self.profile_file or self.profile_samples):
            yield Problem("profile", "only accepted with a velocity: a pressure has none", short(self.profile))
        if self.pressure is None and self.direction != "free":
            yield Problem("direction", "only accepted with a pressure", short(self.direction))


def _series_of_file(name: str, harmonics: int | None, period: float | None) -> dict[str, Any]:
    """Return what the samples of a file put in the place of its name."""
    try:
        found = read_waveform(Path(name), HARMONICS if harmonics is None else harmonics, period)
    except ValueError as error:
        refuse([Problem("waveform_file", str(error), short(name))])
    series = Series(cosine=found.cosine, sine=found.sine)
    return {"waveform_file": None, "harmonics": None, "series": series, "period": found.period}


def velocity_problems(inflow: Inflow, height: float, table: str) -> Iterator[Problem]:
    """Yield why the mean velocity does not follow from peak_velocity or flow_rate at an inlet of this height (m)."""
    largest, mean = _size_of_profile(inflow, height)
    for key, size, what in (("peak_velocity", largest, "largest value"), ("flow_rate", mean, "mean")):
        if getattr(inflow, key) is not None and not size > 0:
            text = f"needs a profile whose {what} is positive, that of this one is {short(size)}"
            yield Problem(f"{table}.{key}", text, short(getattr(inflow, key)))


def with_mean_velocity(inflow: InflowType, height: float) -> InflowType:
    """Return the inflow with mean_velocity in the place of peak_velocity or flow_rate; height: of the inlet, m."""
    largest, mean = _size_of_profile(inflow, height)
    if inflow.peak_velocity is not None:
        velocity = inflow.peak_velocity / largest
    else:
        assert inflow.flow_rate is not None
        velocity = inflow.flow_rate / (mean * height)
    return inflow.model_copy(update={"mean_velocity": velocity, "peak_velocity": None, "flow_rate": None})


def mean_of_profile(inflow: Inflow, height: float) -> float:
    """Return the profile's mean over an inlet of a height, m, dimensionless."""
    return _size_of_profile(inflow, height)[1]


def _size_of_profile(inflow: Inflow, height: float) -> tuple[float, float]:
    """Return the profile's largest value and its mean over the inlet, both dimensionless; 0 of what is rounding."""
    y = np.linspace(0.0, height, 2001)
    values = inflow.expression.evaluate(y=y, H=height)
    simpson = np.full(y.size, 2.0)
    simpson[1::2] = 4.0
    simpson[[0, -1]] = 1.0
    rounding = 1e-9 * np.abs(values).max()
    found = (float(values.max()), float(simpson @ values / simpson.sum()))
    largest, mean = (each if abs(each) > rounding else 0.0 for each in found)
    return largest, mean


class Forces(Table):
    """Scale of the force coefficients C = 2 f / (density mean_velocity^2 reference_length)."""

    reference_length: Length = Field(description="reference length, m")
