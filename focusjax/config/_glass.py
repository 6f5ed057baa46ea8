"""Tables of a config that say what a lens is made of."""

from collections.abc import Callable
from typing import Annotated

from pydantic import Field, Strict, model_validator

from focusjax.config._values import Number, Table
from focusjax.optics import AbstractGlass, stated_glass

Numbers = Annotated[tuple[Number, ...], Strict(False)]


class SellmeierTable(Table):
    """`sellmeier` of a glass: n^2 = 1 + sum_i b_i L^2 / (L^2 - c_i), L the wavelength in micrometres."""

    b: Numbers = Field(description="Sellmeier's coefficients B, usually three numbers in brackets")
    c_um2: Numbers = Field(description="Sellmeier's coefficients C in micrometres squared, as many as b")


class GlassTable(Table):
    """`glass`: what something is made of, in exactly one of five forms."""

    name: str | None = Field(default=None, description='the name of a glass, for example "N-BK7"')
    n_d: Number | None = Field(
        default=None, description="the index at the yellow line d, for example 1.5168, with v_d"
    )
    v_d: Number | None = Field(default=None, description="the Abbe number, for example 64.17, with n_d")
    sellmeier: SellmeierTable | None = Field(default=None, description="a table of b and c_um2")
    n: Numbers | None = Field(
        default=None,
        description="the indices of [red, green, blue] at 650, 510 and 475 nm, such as [1.51, 1.52, 1.53]",
    )
    lines: dict[str, Number] | None = Field(
        default=None,
        description="indices by spectral lines, for example {C = 1.51432, d = 1.5168, F = 1.52238}",
    )

    @model_validator(mode="after")
    def _one_form(self) -> "GlassTable":
        stated = self._stated
        if self.name is None:
            stated_glass(stated)
        elif stated:
            raise ValueError(f"has name and {min(stated)}, which both say its index; give one of them")
        return self

    @property
    def _stated(self) -> dict:
        return self.model_dump(exclude={"name"}, exclude_none=True)

    def made(self, find: Callable[[str], AbstractGlass]) -> AbstractGlass:
        """The glass, by `find` where it is named.

        Raises:
            ValueError: there is none of that name.
        """
        return stated_glass(self._stated) if self.name is None else find(self.name)


class ElementTable(Table):
    """`[[lens.elements]]`: another glass for an element of a prescription."""

    element: Annotated[int, Field(ge=1)] = Field(
        description="the number of an element from 1, counted from the scene's side"
    )
    glass: GlassTable = Field(description="its glass, for example {n_d = 1.5168, v_d = 64.17}")
