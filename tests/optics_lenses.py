"""Lenses that the tests of real lenses share."""

import jax.numpy as jnp

from focusjax.optics import (
    PRESETS,
    Conic,
    EvenAsphere,
    Prescription,
    air,
    find_glass,
    lens_preset,
    make_prescription,
    singlet,
)

GLASS = find_glass("N-BK7")


def aspheric_singlet(front, name: str = "aspheric") -> Prescription:
    """A singlet 6 mm thick with a hyperboloid behind."""
    back = Conic(jnp.asarray(-1 / 80.0), jnp.asarray(-2.0))
    return make_prescription([front, back], [6.0, 0.0], [9.0, 9.0], [GLASS, air()], stop=0, name=name)


def biconvex() -> Prescription:
    return singlet(50.0, -50.0, thickness=5.0, semi_diameter=9.0, glass=GLASS, name="biconvex")


def asphere() -> Prescription:
    fourth = jnp.asarray([0.0, 2e-6, -3e-9, 1e-12])
    return aspheric_singlet(EvenAsphere(jnp.asarray(1 / 40.0), jnp.asarray(0.3), fourth), "asphere")


def all_lenses() -> dict[str, Prescription]:
    """The shipped ones, and singlets with surfaces of every kind of revolution."""
    return {
        **{name: lens_preset(name) for name in PRESETS},
        "biconvex": biconvex(),
        "planoconvex": singlet(float("inf"), -30.0, thickness=4.0, semi_diameter=9.0, glass=GLASS),
        "meniscus": singlet(20.0, 45.0, thickness=4.0, semi_diameter=9.0, glass=find_glass("N-SF11")),
        "conic": aspheric_singlet(Conic(jnp.asarray(1 / 40.0), jnp.asarray(-0.6)), "conic"),
        "asphere": asphere(),
    }
