"""The axes that a design through the closed loop is tried on: the study's, and harder ones."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax

from experiments.axes import linear_motor as motor
from experiments.paper.runs import PERIODS
from jaxid._types import Interval
from jaxid.loop.controllers import ARC
from jaxid.loop.disturbances import (
    AgainstTracking,
    Disturbance,
    LowSpeedFriction,
    NoDisturbance,
    random_shares,
)
from jaxid.loop.scenarios import Scenarios, every, vertices
from jaxid.model.system import System
from jaxid.motion.acceleration_limit import acceleration_limit, acceleration_reach
from jaxid.motion.limits import Limits

# Weak: the axis is up to 7 % of its top speed and 14 mm off its motion.
GAINS = {
    "study": motor.ARC_GAINS,
    "provable": motor.PROVABLE_GAINS,
    "weak": {"k1": 20.0, "k2": 10.0, "epsilon": 1.0, "gamma": (0.0, 0.0, 0.0, 0.0)},
}


@dataclass(frozen=True)
class Setting:
    """What differs from the motor of the study.

    Attributes:
        label: for tables.
        input: limit of |u|, V.
        mass: times the interval of M.
        bandwidth: of H_f, rad/s.
        gains: of ARC, one of `GAINS`.
        friction: of the nominal axis at low speed, V; within δ.
    """

    label: str
    input: float = 10.0
    mass: float = 1.0
    bandwidth: float = motor.BANDWIDTH
    gains: str = "study"
    friction: float = 0.0

    def system(self) -> System:
        """The model with its box."""
        system = motor.system()
        return eqx.tree_at(
            lambda s: s.terms[0].interval, system, replace_fn=lambda x: x * self.mass
        )

    def controller(self) -> ARC:
        """The law, which knows the box."""
        return ARC(self.system(), **GAINS[self.gains])

    def limits(self) -> Limits:
        """Of the axis itself: by the input it may be given, and no other limit of acceleration."""
        return self._limits(acceleration_reach)

    def limits_by_18(self) -> Limits:
        """Of the desired motion, as the paper plans it."""
        return self._limits(acceleration_limit)

    def _limits(self, accelerations: Callable[..., Interval]) -> Limits:
        whole = motor.limits()
        box = {name: tuple(getattr(whole, name).tolist()) for name in ("position", "velocity")}
        box["input"] = (-self.input, self.input)
        return Limits(acceleration=accelerations(self.system(), **box), jerk=whole.jerk, **box)

    @property
    def planned_as_in_study(self) -> bool:
        """Whether (18) asks for the motions of the study: neither box nor limits are others."""
        return self.input == STUDY.input and self.mass == STUDY.mass

    def nominal(self) -> Scenarios:
        """The plant in the middle of the box."""
        system = self.system()
        return every(system, system.centre[None], [self._disturbance()])

    def plants(self, ticks: int) -> Scenarios:
        """Every corner of the box: its own disturbance, cogging, an adversary, random forces.

        Args:
            ticks: of one motion.
        """
        kinds = [
            self._disturbance(),
            motor.plant().disturbance,
            AgainstTracking(self.controller().k1),
            random_shares(jax.random.key(0), PERIODS * ticks),
        ]
        return every(self.system(), vertices(self.system()), kinds)

    def _disturbance(self) -> Disturbance:
        return LowSpeedFriction(self.friction, 0.05) if self.friction else NoDisturbance()


STUDY = Setting("study")
HARDER = (
    Setting("7 V", input=7.0),
    Setting("w = 30", bandwidth=30.0),
    Setting("heavy plant", mass=2.0),
    Setting("weak gains", gains="weak"),
    Setting("low-speed friction", friction=0.2),
    Setting("all of these", 7.0, 2.0, 30.0, "weak", 0.2),
)
