"""The axes of the designs through the closed loop: the axis of the study, and harder ones."""

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

# With the weak gains, tracking errors reach 14 mm and 7 % of the top speed.
GAINS = {
    "study": motor.ARC_GAINS,
    "provable": motor.PROVABLE_GAINS,
    "weak": {"k1": 20.0, "k2": 10.0, "epsilon": 1.0, "gamma": (0.0, 0.0, 0.0, 0.0)},
}


@dataclass(frozen=True)
class Setting:
    """An axis that differs from the motor of the study.

    Attributes:
        label: name in tables.
        input: limit of |u|, V.
        mass: factor on the prior interval of M.
        bandwidth: bandwidth w of H_f, rad/s.
        gains: gains of ARC, a key of `GAINS`.
        friction: additional friction of the nominal axis at low speed, V; within δ.
    """

    label: str
    input: float = 10.0
    mass: float = 1.0
    bandwidth: float = motor.BANDWIDTH
    gains: str = "study"
    friction: float = 0.0

    def system(self) -> System:
        """Return the model with its prior box."""
        system = motor.system()
        return eqx.tree_at(
            lambda s: s.terms[0].interval, system, replace_fn=lambda x: x * self.mass
        )

    def controller(self) -> ARC:
        """Return the controller, which knows the prior box."""
        return ARC(self.system(), **GAINS[self.gains])

    def limits(self) -> Limits:
        """Return the limits of the axis itself, derived from its input limit.

        There is no other limit of the acceleration.
        """
        return self._limits(acceleration_reach)

    def limits_by_18(self) -> Limits:
        """Return the limits of the desired motion by (18), as planned in the paper."""
        return self._limits(acceleration_limit)

    def _limits(self, accelerations: Callable[..., Interval]) -> Limits:
        whole = motor.limits()
        box = {name: tuple(getattr(whole, name).tolist()) for name in ("position", "velocity")}
        box["input"] = (-self.input, self.input)
        return Limits(acceleration=accelerations(self.system(), **box), jerk=whole.jerk, **box)

    @property
    def planned_as_in_study(self) -> bool:
        """Whether (18) gives the motions of the study: prior box and limits are the same."""
        return self.input == STUDY.input and self.mass == STUDY.mass

    def nominal(self) -> Scenarios:
        """Return the plant at the centre of the prior box."""
        system = self.system()
        return every(system, system.centre[None], [self._disturbance()])

    def plants(self, ticks: int) -> Scenarios:
        """Return plants at every corner of the prior box, each with four kinds of disturbance.

        The kinds are the disturbance of the setting, cogging with low-speed friction, a worst-case
        disturbance, and random forces.

        Args:
            ticks: number of sample periods of one motion.
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
