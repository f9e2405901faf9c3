"""The values procedures and bench files are made of: quantities by their unit suffix, and names."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from bench.fields import Quantity

Time = Annotated[float, Quantity("s")]
Temperature = Annotated[float, Quantity("degc")]
Kelvin = Annotated[float, Quantity("k")]
Ratio = Annotated[float, Quantity("ppm")]
Slope = Annotated[float, Quantity("degc_min")]
Rate = Annotated[float, Quantity("dps")]
Angle = Annotated[float, Quantity("deg")]
Drift = Annotated[float, Quantity("dph")]

Order = Literal["up", "down", "alternate", "random"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
